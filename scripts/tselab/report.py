"""The report: one HTML file that needs nothing else, readable offline."""

from __future__ import annotations

import base64
import gzip
import json
from pathlib import Path

import jinja2
import plotly.offline
from markupsafe import Markup

from tselab import __version__, plots
from tselab.core import Config, library
from tselab.estimate import Estimate
from tselab.facts import run_facts
from tselab.files import atomic
from tselab.log import Log
from tselab.vehicle import Vehicle
from tselab.verdict import verdicts


def write_report(path: Path, est: Estimate, log: Log, vehicle: Vehicle, config: Config, notes: list[str]) -> None:
    """Write the report of a run."""
    data = plots.Data(est.table, log.data, log.ref)
    sections = [
        ("Stiffness", "Grey background: not valid; the reason is shown on hover. Drag to zoom, double-click to reset; all plots "
         "share the time axis.", plots.stiffness_figure(data, config)),
        ("States", "Estimates against the reference columns of the log, where there are any.", plots.states_figure(data)),
        ("Inputs and measurements", "The log as it was read; references are off until their legend entry is clicked.",
         plots.inputs_figure(data)),
        ("Health of the filter", "Sensor biases, how well each row was foreseen, how many particles carry the weight, status.",
         plots.health_figure(data)),
        ("Other reference columns", "Columns of the log that start with ref_ and match no estimate.", plots.others_figure(data)),
    ]  # fmt: skip
    shown = [(title, text, figure) for title, text, figure in sections if figure is not None]
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("tselab"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    page = environment.get_template("report.html.j2").render(
        title=log.path.name,
        vehicle=vehicle,
        verdicts=verdicts(est.table, config),
        sections=[
            {"id": f"plot{i}", "title": t, "text": x, "height": f.layout.height} for i, (t, x, f) in enumerate(shown)
        ],
        figures=_packed("[" + ",".join(f.to_json() for _, _, f in shown) + "]"),
        plotly=_packed(plotly.offline.get_plotlyjs()),
        facts=run_facts(est, log, vehicle, config, data.stride),
        changed=[(config.fields[name], value) for name, value in config.changed().items()],
        notes=notes,
        library=library(),
        version=__version__,
    )
    with atomic(path) as file:
        file.write(page)


def _packed(text: str) -> Markup:
    """Compressed and in letters that need no escaping."""
    return Markup(base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode())


def figures_of(page: str) -> list[dict]:
    """The figures inside a report, unpacked: for tests and for readers with a script."""
    packed = page.split('id="figures">', 1)[1].split("<", 1)[0]
    return json.loads(gzip.decompress(base64.b64decode(packed)))
