"""CITATION.cff is of this version, and what the format wants is there (Citation File Format 1.2.0, required keys and types)."""

from __future__ import annotations

import re
from datetime import date
from pathlib import Path

import pytest

import tse

ROOT = Path(__file__).resolve().parent.parent
REFERENCE_TYPES = {"article", "book", "conference", "conference-paper", "generic", "proceedings", "report", "software"}


@pytest.fixture(scope="module")
def said():
    yaml = pytest.importorskip("yaml")
    return yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))


def people(of):
    for who in of["authors"]:
        assert ("name" in who) != ({"family-names", "given-names"} <= set(who)), who


def test_it_has_what_the_format_requires(said):
    assert said["cff-version"] == "1.2.0" and said["type"] in ("software", "dataset")
    assert all(isinstance(said[key], str) and said[key] for key in ("message", "title", "version", "license"))
    assert isinstance(said["date-released"], date)
    people(said)
    for reference in said["references"]:
        assert reference["type"] in REFERENCE_TYPES and reference["title"]
        assert isinstance(reference["year"], int)
        people(reference)


def test_it_is_of_this_version_and_the_changelogs_day(said):
    assert said["version"] == tse.__version__
    day = re.search(rf"^## \[{re.escape(tse.__version__)}\] - (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.M)[1]
    assert said["date-released"].isoformat() == day
    licence = (ROOT / "LICENSE").read_text()
    assert said["license"] == "Apache-2.0" and "Apache License" in licence and "Version 2.0" in licence
