"""The part of a film that many points hold together."""

import numpy as np
import scene
from sfm.test_sound import to_model

from massprops.sfm.firm_part import firm_part


def names(model):
    return sorted(model.image(i).name for i in model.reg_image_ids())


def film(least_across):
    """A film of 20 images whose points are each seen in four images, with fewer across the step from image 6 to 7."""
    views, points = scene.make(20, 600, step_deg=4.0)
    first = np.arange(600) % 17
    shown = (points.obs_view >= first[points.obs_point]) & (points.obs_view < first[points.obs_point] + 4)
    across = (first <= 6) & (first + 3 >= 7)
    keep = np.zeros(600, bool)
    keep[np.flatnonzero(across)[:least_across]] = True
    return views, points.observed(shown & (keep | ~across)[points.obs_point])


def test_a_film_is_cut_where_few_points_tie_it() -> None:
    views, points = film(12)
    assert names(firm_part(to_model(views, points), list(views.names), 30)) == list(views.names[7:])


def test_a_film_that_holds_stays_whole() -> None:
    views, points = film(60)
    model = to_model(views, points)
    assert firm_part(model, list(views.names), 30) is model


def test_two_rays_tie_nothing() -> None:
    views, points = film(60)
    seen = [points.obs_view[points.obs_point == p] for p in range(len(points.xyz))]
    across = np.array([bool(np.isin((6, 7), s).all()) for s in seen])
    two = points.observed(~across[points.obs_point] | np.isin(points.obs_view, (6, 7)))
    assert names(firm_part(to_model(views, two), list(views.names), 30)) == list(views.names[7:])


def test_parts_too_short_to_tell_a_rate_are_not_begun_from() -> None:
    views, points = scene.make(6, 40, step_deg=4.0)
    model = to_model(views, points.observed(points.obs_point < 20))
    assert firm_part(model, list(views.names), 30) is model
