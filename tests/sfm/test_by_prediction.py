"""A film of something that stands on a printed cloth: what places its images, and what judges their places."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from massprops.sfm import grown_film
from massprops.sfm.attempt import ModelInputs


class Model:
    """A model that counts its images."""

    def __init__(self, images: int) -> None:
        self.images = images

    def num_reg_images(self) -> int:
        """Images that are placed."""
        return self.images

    def reg_image_ids(self) -> list[int]:
        """Their numbers."""
        return list(range(self.images))


def inputs(background: str = "still", repeats: bool = True) -> Any:
    """Forty images of a film, of whose features most have twins."""
    footage = SimpleNamespace(
        moving_pictures=True, rig=False, background=background, frames=[SimpleNamespace(name=str(i)) for i in range(40)]
    )
    found: Any = SimpleNamespace(repeats=repeats, database=Path("matches.db"))
    return ModelInputs(found, footage, SimpleNamespace(), Path("work"))  # type: ignore[arg-type]


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What was done, in order; what is unique places 30 images, the motion all."""
    done: list[Any] = []

    def note(name: str, result: Any) -> None:
        def step(model: Any, given: Any, *_: Any) -> Any:
            done.append(name)
            return result or model

        monkeypatch.setattr(grown_film, name, step)

    note("firm_part", None)
    note("match_predicted", None)
    note("add_left_out_images", Model(30))
    note("_followed", Model(40))
    monkeypatch.setattr(grown_film, "_steady_part", lambda model, given: (model, given.found))
    monkeypatch.setattr(grown_film, "with_pieces", lambda model, found, given: (model, []))
    monkeypatch.setattr(grown_film, "take_out_unsupported", lambda model, db, known: done.append((db, len(known))))
    return done


def test_what_is_unique_places_a_still_things_images_before_its_motion_does(steps: list[Any]) -> None:
    model, _, said = grown_film.by_prediction(Model(16), inputs(), Path("first.db"), tumbling=False)
    first = Path("first.db")
    assert steps == ["firm_part", "match_predicted", "add_left_out_images", "_followed", (first, 30)]
    assert model.num_reg_images() == 40 and said == []


def test_a_free_bodys_images_are_placed_by_its_motion_alone(steps: list[Any]) -> None:
    given = inputs("black")
    grown_film.by_prediction(Model(16), given, Path("first.db"), tumbling=True)
    assert steps == ["match_predicted", "_followed"]


def test_a_film_that_is_placed_whole_costs_nothing_more(steps: list[Any]) -> None:
    grown_film.by_prediction(Model(40), inputs(), Path("first.db"), tumbling=False)
    assert steps == ["firm_part", "match_predicted"]


@pytest.mark.parametrize(("against_all", "all_of_it"), [(0.0, True), (0.02, False)])
def test_where_matches_contradict_what_the_firm_part_grew_to_all_of_it_is_asked(
    steps: list[Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, against_all: float, all_of_it: bool
) -> None:
    first, database = tmp_path / "first.db", tmp_path / "matches.db"
    first.write_bytes(b"without a model")
    database.write_bytes(b"of the firm part")
    whole, given = Model(40), inputs()
    given = ModelInputs(SimpleNamespace(repeats=True, database=database), given.footage, given.options, tmp_path)  # type: ignore[arg-type]

    def shares(model: Any, matches: Path) -> Any:
        assert matches == first
        return SimpleNamespace(share=against_all if model is whole else 0.02)

    monkeypatch.setattr(grown_film, "firm_part", lambda model, order, least: Model(16))
    monkeypatch.setattr(grown_film, "contradictions", shares)
    model, _, _ = grown_film.by_prediction(whole, given, first, tumbling=False)
    assert (model is whole) == all_of_it and model.num_reg_images() == 40
    assert database.read_bytes() == (b"without a model" if all_of_it else b"of the firm part")


def test_matches_made_without_a_model_are_kept(tmp_path: Path) -> None:
    database = tmp_path / "a" / "matches.db"
    database.parent.mkdir()
    database.write_bytes(b"before")
    kept = grown_film.kept_matches(database, tmp_path)
    database.write_bytes(b"after")
    assert kept.read_bytes() == b"before"
