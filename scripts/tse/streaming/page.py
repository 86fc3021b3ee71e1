"""Web server on this machine for a page with plots of a running drive. The page has the
same charts as docs/try.html, which runs the filter in the browser. Here the filter runs
on this machine, and the page only shows its estimates."""

from __future__ import annotations

import json
import math
import threading
from array import array
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np

from tse.car.vehicle import DRIVEN
from tse.estimation.answer import make_answer
from tse.estimation.regimes import REGIMES
from tse.library.core import NOMINAL, REASON, STIFFNESS, library
from tse.streaming.drive import LiveDrive

TEMPLATES = Path(__file__).parents[1] / "report" / "templates"
SHOWN = 0.05  # [s] min time between two rows that the page shows
# Max number of rows that are kept: one hour at 1 / SHOWN = 20 rows per second. If there
# are more, MAX_KEPT / 2 rows are dropped, the oldest ones
MAX_KEPT = 72_000
AT_A_TIME = 4000  # max number of rows in one response to the browser


class Page:
    """The page and its server. add() stores new rows. The server answers the requests of
    browsers in threads of its own.

    Parameters
    ----------
    live : LiveDrive
        The drive.
    port : int
        TCP port; 0: any free one.
    car : str
        Sentence that the page shows above the charts if the car is not calibrated;
        otherwise empty.
    """

    def __init__(self, live: LiveDrive, port: int = 0, car: str = ""):
        self._live = live
        self._car = car
        # True for rear-wheel drive: the page shows the longitudinal stiffness of the rear
        # axle. False: it shows the longitudinal stiffness of the front axle
        self._rear = live.config.driven_axle == DRIVEN["rear"]
        self._lock = threading.Lock()
        self._gone = 0  # number of dropped rows
        self._last = -np.inf
        names = ["time", *(f"{s}{x}" for s in STIFFNESS for x in ("", "_sd", "_valid", "_reason")), *REGIMES]
        self._columns = {n: array("d") for n in names}
        codes = library().codes(REASON)
        self._reasons = [codes[k].name for k in sorted(codes)]
        page = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                page._answer(self)

            def log_message(self, format: str, *args: Any) -> None:
                """Do not log requests."""

        self._server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_port}/"
        threading.Thread(target=self._server.serve_forever, daemon=True, name="page").start()

    def add(self, times: np.ndarray, outputs: np.ndarray) -> None:
        """Store rows for the page. A row that follows the last stored row by less than
        SHOWN seconds is left out, because the page does not need more rows.

        `times`: (rows,) [s]. `outputs`: (rows,) outputs of the library."""
        for t, o in zip(times.tolist(), outputs, strict=True):
            if t < self._last + SHOWN - 1e-6:
                continue
            self._last = t
            row = {"time": t, **{p: float(o[p]) for p in REGIMES}}
            for s in STIFFNESS:
                nominal = "longitudinal_stiffness_rear" if self._rear and s == "cx_front" else NOMINAL[s]
                by = getattr(self._live.config, nominal) / 1000
                reason = int(o[f"{s}_valid"])
                row |= {
                    s: float(o[s]) * by,
                    f"{s}_sd": float(o[f"{s}_sd"]) * by,
                    f"{s}_valid": float(reason == 0),
                    f"{s}_reason": float(reason),
                }
            with self._lock:
                for n, x in row.items():
                    self._columns[n].append(x)
                if len(self._columns["time"]) > MAX_KEPT:
                    for x in self._columns.values():
                        del x[: MAX_KEPT // 2]
                    self._gone += MAX_KEPT // 2

    def close(self) -> None:
        """Stop the server."""
        self._server.shutdown()
        self._server.server_close()

    def _answer(self, to: BaseHTTPRequestHandler) -> None:
        asked = urlsplit(to.path)
        if to.headers.get("Host", "").partition(":")[0] not in ("127.0.0.1", "localhost"):
            to.send_error(403)  # a website whose host name resolves to this machine must not read the drive
        elif asked.path == "/":
            self._send(to, "text/html; charset=utf-8", read_page().encode())
        elif asked.path == "/rows":
            query = {k: int(v[0]) if v[0].isdigit() else 0 for k, v in parse_qs(asked.query).items()}
            found = self._make_state(query.get("from", 0), query.get("events", 0))
            self._send(to, "application/json", json.dumps(found).encode())
        else:
            to.send_error(404)

    @staticmethod
    def _send(to: BaseHTTPRequestHandler, kind: str, body: bytes) -> None:
        to.send_response(200)
        to.send_header("Content-Type", kind)
        to.send_header("Content-Length", str(len(body)))
        to.send_header("Cache-Control", "no-store")
        to.end_headers()
        to.wfile.write(body)

    def _make_state(self, first: int, events: int) -> dict[str, Any]:
        """Return what the script of the page needs: the rows from number `first` on, at
        most AT_A_TIME of them; the events from number `events` on; and the present
        stiffnesses as text."""
        with self._lock:
            count = self._gone + len(self._columns["time"])
            first = first if self._gone <= first <= count else self._gone
            last = min(count, first + AT_A_TIME)
            part = slice(first - self._gone, last - self._gone)
            columns = {
                n: [float(f"{v:.6g}") if math.isfinite(v) else None for v in x[part]]
                for n, x in self._columns.items()
            }
            columns["time"] = [round(t, 3) for t in self._columns["time"][part]]
        drive, said = self._live.drive, self._live.said
        return {
            "begin": self._gone,
            "from": first,
            "next": last,
            "columns": columns,
            "reasons": self._reasons,
            "car": self._car,
            "along": "Rear" if self._rear else "Front",
            "answer": make_answer(self._live.now(), self._live.config),
            "state": f"{drive.time:.0f} s, {drive.rows} rows, {drive.frames} frames, "
            f"{1e3 * drive.delay:.0f} ms behind",
            "events": said[events:],
            "nextEvent": len(said),
        }


def read_page() -> str:
    """Return the HTML of the page, with style sheet and script inserted."""
    text = (TEMPLATES / "live.html").read_text(encoding="utf-8")
    for mark, name in (("/* @style@ */", "page.css"), ("/* @script@ */", "draw.js")):
        text = text.replace(mark, (TEMPLATES / name).read_text(encoding="utf-8"))
    return text
