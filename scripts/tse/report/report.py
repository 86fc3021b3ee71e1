"""Write the report: one self-contained HTML file, which can be read offline."""

import base64
import gzip
import json
import pkgutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import orjson
from markupsafe import Markup

from tse.car.vehicle import Vehicle
from tse.estimation import regimes
from tse.estimation.answer import compute_held_stiffness, describe_rest
from tse.estimation.estimate import Estimates
from tse.estimation.verdict import Finding, make_findings
from tse.library import __version__
from tse.library.core import Config, library
from tse.library.files import write_atomically
from tse.log.rows import CheckedLog
from tse.report import plots
from tse.report.results import list_run_facts

# Max number of stretches of road with a box for each stiffness, which shows value and
# verdict (usable, usable in part, not valid). A stretch is the part of the drive from one
# detected change of the stiffness to the next. A table below lists all stretches.
MAX_CARDS = 6
MAX_TABLE_EVENTS = 200  # max number of events in the table
GZIP_LEVEL = 4  # gzip compression level; level 9 takes three times as long and saves 3 %


def write_report(
    path: Path,
    est: Estimates,
    log: CheckedLog,
    vehicle: Vehicle,
    config: Config,
    notes: list[str],
    data: plots.Data | None = None,
    contradictions: Sequence[str] = (),
    judged: tuple[list[regimes.Change], list[Finding]] | None = None,
) -> None:
    """Write the report of a run.

    `data`: lines of the plots; None: made from `log` and `est.table`. `judged`: detected
    changes of the stiffness, and findings; None: computed from `est.table`.
    `contradictions`: warnings that channels contradict each other or the vehicle file;
    used only if `judged` is None."""
    if data is None:
        data = plots.Data(log)
        data.add(est.table)
    if judged is None:
        changes = regimes.find_changes(est.table)
        judged = changes, make_findings(est.table, config, changes, contradictions, est.uncertainty_sd)
    (changes, found), spells = judged, regimes.find_spells(est.table)
    sections = [
        (
            "Stiffness",
            "Grey background: not valid; the reason is shown on hover. Drag to zoom, double-click to "
            "reset. All plots share the time axis.",
            plots.draw_stiffness(data, est.table, config, changes, spells),
        ),
        (
            "States",
            "Estimates, and the reference columns of the log if it has any.",
            plots.draw_states(data, config.form == 0 and config.grip_sd > 0),
        ),
        (
            "Inputs and measurements",
            "The log as it was read. Click a reference in the legend to show it.",
            plots.draw_inputs(data),
        ),
        (
            "Health of the filter",
            "Sensor biases, log-likelihood of each row, innovations or effective particles, status.",
            plots.draw_health(data),
        ),
        (
            "Other reference columns",
            "Columns of the log that start with ref_ and match no estimate.",
            plots.draw_other_references(data),
        ),
    ]
    write_page(
        path,
        "report.html.j2",
        sections,
        title=log.path.name,
        vehicle=vehicle,
        findings=found,
        spread=config.form != 0,
        most=MAX_CARDS,
        events=list_events(changes, spells),
        facts=list_run_facts(est, log, vehicle, config, data.stride),
        changed=[(config.fields[name], value) for name, value in config.changed().items()],
        notes=notes,
        filters={"held": compute_held_stiffness, "beside": describe_rest},
    )


def write_page(path: Path, template: str, sections: Sequence[tuple[str, str, Any]], **words: Any) -> None:
    """Write a self-contained HTML page.

    `sections` has title, text and figure of each section. The figure is a plots.Figure or
    a plotly figure. A section whose figure is None is left out. `words`: further
    variables of the template. The keyword `filters` is no variable, but has the jinja2
    filters of the template: name -> function."""
    shown = [(title, text, figure) for title, text, figure in sections if figure is not None]
    figures = [f.as_dict() if hasattr(f, "as_dict") else orjson.Fragment(f.to_json()) for _, _, f in shown]
    heights = [f.height if hasattr(f, "as_dict") else f.layout.height for _, _, f in shown]
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("tse.report"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= words.pop("filters", {})
    page = environment.get_template(template).render(
        sections=[
            {"id": f"plot{i}", "title": title, "text": text, "height": height}
            for i, ((title, text, _), height) in enumerate(zip(shown, heights, strict=True))
        ],
        figures=pack_text(orjson.dumps(figures, option=orjson.OPT_SERIALIZE_NUMPY)),
        plotly=pack_text(pkgutil.get_data("plotly", "package_data/plotly.min.js") or b"") if shown else "",
        library=library(),
        version=__version__,
        **words,
    )
    with write_atomically(path) as file:
        file.write(page)


def list_events(
    changes: Sequence[regimes.Change], spells: Sequence[regimes.Spell]
) -> list[tuple[str, str, str, str]]:
    """Return time, name, probability and effect of each event as strings, in order of
    time. An event is a change of the stiffness, or an interval in which a sensor was at
    fault or the wheels slid.

    At most MAX_TABLE_EVENTS events are returned: those with the largest `probability`
    (attribute of Change and Spell). For a change, the string of the probability is empty,
    because Change.probability is not the probability that the change is real."""
    rows = [(c.time, f"{c.time:.2f} s", c.what, c.probability, "", c.effect) for c in changes]
    for s in spells:
        when, shown = f"{s.start:.2f} .. {s.end:.2f} s", regimes.format_percent(s.probability)
        rows.append((s.start, when, s.name, s.probability, shown, ""))
    likeliest = sorted(rows, key=lambda r: -r[3])[:MAX_TABLE_EVENTS]
    return [(when, what, shown, effect) for _, when, what, _, shown, effect in sorted(likeliest)]


def pack_text(text: str | bytes) -> Markup:
    """Return text compressed by gzip and encoded in base64. The result contains no
    characters that must be escaped in HTML."""
    data = text.encode() if isinstance(text, str) else text
    return Markup(base64.b64encode(gzip.compress(data, GZIP_LEVEL, mtime=0)).decode())


def read_figures(page: str) -> list[dict]:
    """Return the figures that a report contains, for tests and scripts."""
    packed = page.split('id="figures">', 1)[1].split("<", 1)[0]
    return json.loads(gzip.decompress(base64.b64decode(packed)))
