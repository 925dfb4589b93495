"""The page of the command line is what the program says."""

import importlib

import pytest
from repository import ROOT


@pytest.fixture
def generate(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    return importlib.import_module("generate")


def test_the_page_is_generated_from_the_parsers(generate):
    assert generate.PAGE.read_text(encoding="utf-8") == generate.page(), "run ./dev docs"


def test_the_page_lists_every_option_of_a_bake(generate):
    _, _, section = generate.page().partition("\n## gsgi bake\n")
    section, _, _ = section.partition("\n## gsgi ")
    for option in (
        "--quality",
        "--target-loss",
        "--depfile",
        "--no-evaluate",
        "--preview",
        "--json",
        "-o, --output FILE",
    ):
        assert option in section
