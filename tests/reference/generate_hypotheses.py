#!/usr/bin/env python3
"""Write hypotheses_table.h: log densities of Student-t samples by scipy, for test_innovate.c and test_bank.c.

python3 generate_hypotheses.py        writes hypotheses_table.h next to this file; needs numpy and scipy; deterministic
"""

from pathlib import Path

import numpy as np
from scipy.stats import multivariate_t

DOF = 8  # EVIDENCE_DOF of tse/constants.def


def row(values):
    return ", ".join(repr(float(v)) for v in np.ravel(values))


def main():
    rng = np.random.default_rng(20)
    cases = []
    for channels in (1, 2, 3):
        for size in (0.1, 1.0, 3.0, 30.0):
            root = rng.normal(size=(channels, channels))
            s = np.eye(channels) + root @ root.T
            e = size * rng.normal(size=channels)
            whole, off = np.eye(3), np.zeros(3)
            whole[:channels, :channels] = s
            off[:channels] = e
            logpdf = multivariate_t.logpdf(e, np.zeros(channels), s, df=DOF)
            cases.append(f"  {{ {channels}, {{ {row(off)} }}, {{ {row(whole)} }}, {float(logpdf)!r} }},")
    text = [
        "/* Written by generate_hypotheses.py. Scale matrix of a Student-t with 8 degrees of freedom; unused: 1. */",
        "",
        "typedef struct density_case {",
        "  int channels;",
        "  double e[3], s[9], log_density;",
        "} density_case;",
        "",
        "static const density_case density_cases[] = {",
        *cases,
        "};",
    ]
    (Path(__file__).parent / "hypotheses_table.h").write_text("\n".join(text) + "\n")


if __name__ == "__main__":
    main()
