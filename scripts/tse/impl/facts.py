"""What a run was: a few lines for the terminal and the report."""

from __future__ import annotations

from tse.impl.config import filter_text
from tse.impl.core import Config, library
from tse.impl.estimate import Estimate
from tse.impl.rows import Log
from tse.impl.vehicle import Vehicle, latency_settings


def run_facts(est: Estimate, log: Log, vehicle: Vehicle, config: Config, stride: int = 1) -> list[tuple[str, str]]:
    """The run in a few lines: name and value."""
    span = float(est.table["time"].iloc[-1] - est.table["time"].iloc[0]) if len(est) else 0.0
    every = f", every {log.sample_time * 1000:.4g} ms" if log.sample_time else ""
    every += f" (means of {log.averaged} rows)" if log.averaged > 1 else ""
    facts = [
        ("Log", f"{log.path.name}: {len(log)} rows, {span:.1f} s{every}"),
        ("Vehicle", f"{vehicle.name}" + (f" ({vehicle.path.name})" if vehicle.path else "")),
        ("Filter", filter_text(config)),
    ]
    late = {
        channel: 1000 * getattr(config, name) for channel, name in latency_settings().items() if getattr(config, name)
    }
    if late:
        said = ", ".join(f"{channel} {ms:g} ms" for channel, ms in late.items())
        age = 1000 * float(est.table["estimate_age"].min()) if len(est) else 0.0
        facts.append(("Latency", f"{said} behind yaw_rate; estimates are of {age:g} ms before the row"))
    if est.interrupted:
        facts.append(("Stopped", f"by Ctrl-C after {len(est)} of {len(log)} rows"))
    recovered = est.statuses.get(library().status("TSE_W_RECOVERED"), 0)
    if recovered:
        facts.append(("Recoveries", f"{recovered} (what was believed was given up)"))
    if stride > 1:
        facts.append(("Plots", f"the least and the greatest of every {stride} rows"))
    return facts
