"""Every file of a catalogue keeps what the catalogue asks of it: one list for all, so that a new file is held to it too."""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import massprops
from massprops.campaigns.kinds import kinds
from massprops.campaigns.papers import WANTED as papers_want
from massprops.campaigns.papers import papers
from massprops.exchange.formats import WANTED as formats_want
from massprops.exchange.formats import formats
from massprops.packaged import is_flag, is_text, takes
from massprops.run.job import ReconstructOptions
from massprops.run.stages import ALWAYS, EXTRA, ORDER
from massprops.sfm.scale import WANTED as sources_want
from massprops.sfm.scale import sources

ROOT = Path(massprops.__file__).parent
STAGE_OPTIONS = {field.name for field in fields(ReconstructOptions)}


def names(folder: str) -> list[str]:
    return sorted(p.stem for p in (ROOT / folder).glob("*.py") if not p.stem.startswith("_"))


def is_place(value: Any) -> bool:
    return isinstance(value, int | float)


def are_stages(value: Any) -> bool:
    return isinstance(value, tuple) and set(value) <= set(ORDER)


def are_options(value: Any) -> bool:
    return isinstance(value, tuple) and set(value) <= STAGE_OPTIONS


CATALOGUES: dict[str, tuple[list[str], dict[str, Callable[[Any], bool]]]] = {
    "exchange.formats": (names("exchange/formats"), formats_want),
    "run.stages": (list(ORDER), {"READS": are_stages, "OPTIONS": are_options, "run": takes(1)}),
    "campaigns.kinds": (
        kinds(),
        {
            "SENTENCE": is_text,
            "OWN_THREADS": is_flag,
            **dict.fromkeys(("parameters", "check", "prepared", "runs"), callable),
        },
    ),
    "campaigns.papers": (papers(), papers_want),
    "sfm.scale": (list(sources()), sources_want),
    "report.sections": (names("report/sections"), {"TITLE": is_text, "ORDER": is_place, "render": takes(1)}),
}
FILES = [(room, name) for room, (found, _) in CATALOGUES.items() for name in found]


def module_of(room: str, name: str) -> ModuleType:
    return import_module(f"massprops.{room}.{name}")


@pytest.mark.parametrize(("room", "name"), FILES, ids=[f"{room}.{name}" for room, name in FILES])
def test_a_file_has_what_its_catalogue_asks_for(room: str, name: str) -> None:
    module = module_of(room, name)
    assert is_text((module.__doc__ or "").strip()), f"{room}.{name} does not say what it is"
    for wanted, holds in CATALOGUES[room][1].items():
        assert hasattr(module, wanted), f"{room}.{name} lacks {wanted}"
        assert holds(getattr(module, wanted)), f"{room}.{name}: {wanted} = {getattr(module, wanted)!r}"


def test_every_file_of_a_catalogue_is_in_it() -> None:
    assert {m.__name__.rpartition(".")[2] for m in formats().values()} == set(names("exchange/formats"))
    assert set(ORDER) == set(names("run/stages")) and set(ALWAYS) | set(EXTRA) <= set(ORDER)
    assert set(kinds()) == set(names("campaigns/kinds"))
    assert set(sources()) == set(names("sfm/scale"))
    assert set(papers()) == set(names("campaigns/papers"))


def test_a_stage_reads_only_what_ran_before_it() -> None:
    for place, name in enumerate(ORDER):
        assert set(module_of("run.stages", name).READS) <= set(ORDER[:place]), name


@pytest.mark.parametrize(
    "room", ["campaigns.kinds", "campaigns.papers", "exchange.formats", "report.sections", "sfm.scale"]
)
def test_no_file_of_a_catalogue_imports_another(room: str) -> None:
    """So that one can be added, or taken out, without a change elsewhere."""
    found = CATALOGUES[room][0]
    for name in found:
        text = (ROOT / room.replace(".", "/") / f"{name}.py").read_text()
        imported = {n.module for n in ast.walk(ast.parse(text)) if isinstance(n, ast.ImportFrom) and n.module}
        others = {f"massprops.{room}.{other}" for other in found if other != name}
        assert not imported & others, f"{room}.{name} imports {imported & others}"
