"""Forward selection of effects, with a backward check; which cannot be told apart, and whether it is enough."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import ModuleType

import numpy as np

from massprops.diagnosis.criteria import BEATS_NOTHING, BEATS_UNKNOWN
from massprops.diagnosis.search.acceptance import (
    MISPREDICTED,
    PREDICTS,
    acceptable,
    adequate,
    all_needed,
    distinct,
    explained,
    fits,
)
from massprops.diagnosis.search.assumed import DENSITY, contradicts, density_with_each
from massprops.diagnosis.search.by_balance import ByBalance, fits_by_balance
from massprops.diagnosis.search.candidate_fits import FEWEST_FITS, FITS_OF_A_PAIR, Watch, fit_candidates
from massprops.diagnosis.search.case import Case
from massprops.diagnosis.search.event_time import EVIDENCE, best_event_time, between_epochs, moves_at_once
from massprops.diagnosis.search.latent_shift import Shift, latent_shift
from massprops.diagnosis.search.profile import profiled
from massprops.diagnosis.search.refit import MOST_ITERATIONS, POLISH, Added, FittedModel, near, refit, with_effects
from massprops.diagnosis.search.residual_statistics import count, mean_square
from massprops.diagnosis.search.score import score_tests
from massprops.diagnosis.search.stepwise import stepwise
from massprops.effects import changes_motion, effects, forms, places_of
from massprops.model import lacks
from massprops.model.linearise import residuals
from massprops.model.measurements import measurements_of

CLOSE = 6.0
"""Difference of BIC below which two explanations cannot be told apart."""
FIRST_SHARE = 0.35
"""Share of the excess mean square that an effect's simple form may leave over to be thought of as the leading one."""
AS_GOOD = 0.5
"""Share of the best gain of BIC at which an effect's longer forms come before pairs of effects."""
BEAM = 2
FITS_OF_A_FORM = 4
MOST_SCORES = 26
JOINS = 1.05
"""Held-out residual over the noise beyond which the held-out data are asked to join the fit."""
SPOILS = 1e-6
"""Probability by chance of the rise of chi-square with which the held-out data spoil a fit: far less than where the fitted
data leave nothing else open, as the motion is not linear in its parameters."""
SMALL = 1500
"""Scalar measurements up to which every start is fitted for a few iterations rather than scored."""
NEARLY = 0.03
"""Share of the excess mean square that may be left over when an effect is named although structure remains."""


@dataclass
class Selection:
    """The course of a selection.

    Attributes:
        base: the base model; tried: every model fitted with effects; best: the model chosen, or the base.
        rivals: models that explain as much as the best; skipped: effect to why it was not tried.
        verdict: none, named, ambiguous or unexplained. shift: of the images, where it is as likely as the effects of the best.
    """

    base: FittedModel
    tried: list[FittedModel] = field(default_factory=list)
    best: FittedModel | None = None
    rivals: list[FittedModel] = field(default_factory=list)
    skipped: dict[str, str] = field(default_factory=dict)
    verdict: str = "none"
    shift: Shift | None = None


@dataclass(kw_only=True)
class _Course:
    """Where a selection stands.

    Attributes:
        case, base, watch: as `select` takes them; usable: effects that may act; out: what was tried; first: fits of one
            effect; longer: of longer forms; good: those of all that may be named, the best first.
    """

    case: Case
    base: FittedModel
    watch: Watch
    usable: list[ModuleType]
    out: Selection
    first: list[FittedModel]
    longer: list[FittedModel] = field(default_factory=list)
    good: list[FittedModel] = field(default_factory=list)

    def join(self, found: list[FittedModel]) -> None:
        """Takes those of some fits that may be named among the good ones."""
        self.good = sorted([*self.good, *(s for s in found if acceptable(s, self.base))], key=lambda s: s.bic)

    def lengthen(self, modules: list[ModuleType]) -> None:
        """Longer forms of some effects, until one explains the data."""
        longer_forms: list[FittedModel] = []
        for module in modules:
            longer_forms += _longer_forms(self.case, self.base, module, self.first, self.watch)
            if any(explained(s) and acceptable(s, self.base) for s in longer_forms):
                break
        self.longer.extend(longer_forms)
        self.out.tried.extend(longer_forms)
        self.join(longer_forms)

    def balance(self) -> ByBalance:
        """Effects, and pairs of them, as the balance of momentum finds them in the attitudes."""
        cost = min(s.fit.cost for s in [self.base, *self.first])
        by_balance = fits_by_balance(self.case, _of_the_motion(self.case), self.watch, cost)
        balance_fits = list(by_balance.fits)
        self.out.tried += balance_fits
        self.longer += [s for s in balance_fits if len(s.added) == 1]
        self.join([s for s in balance_fits if len(s.added) == 1])
        self.good = sorted(
            [*self.good, *self._needed([s for s in balance_fits if len(s.added) > 1])], key=lambda s: s.bic
        )
        return by_balance

    def beside_density(self) -> None:
        """Uneven density together with each effect."""
        pairs = density_with_each(self.case, self.first, self.usable, self.watch)
        self.out.tried += pairs
        self.good = sorted([*self.good, *self._needed(pairs)], key=lambda s: s.bic)

    def pair(self, violated: bool) -> None:
        """Two effects at once: a second beside each of the best, until a pair is adequate. Where uneven density beside an effect
        already is, beside those alone that leave the inertia as it is assumed."""
        beam = _beam([s for s in self.good if len(s.added) == 1] if violated else self.good)
        if any(adequate(s) for s in self.good):
            beam = [s for s in beam if not contradicts(self.case, s)]
        least = min((s.fit.cost for s in self.good if len(s.added) > 1), default=np.inf)
        for k, s in enumerate(beam):
            rest = [m for m in self.usable if m.NAME not in s.names]
            what = f"two effects, with {s.names[0]} ({k + 1})"
            pairs = fit_candidates(self.case, s, rest, FITS_OF_A_PAIR, self.watch, what, against=least)
            better = self._needed(pairs)
            self.out.tried += pairs
            self.good = sorted([*self.good, *better], key=lambda s: s.bic)
            if any(adequate(p) for p in better):
                break
            least = min(least, *(p.fit.cost for p in pairs)) if pairs else least

    def _needed(self, pairs: list[FittedModel]) -> list[FittedModel]:
        return [p for p in pairs if acceptable(p, self.base) and all_needed(p, [*self.first, *self.longer])]


def select(
    case: Case,
    base: FittedModel,
    watch: Watch = lambda what, done, total: None,
    violated: bool = False,
    other: Case | None = None,
) -> Selection | None:
    """Which effects the base model lacks; None where one of them alone explains more in the `other` case than any in this.

    Args:
        base: the fitted base model; violated: the assumed inertia is contradicted although the residuals are small.
        watch: told of each step.
    """
    out = Selection(base, best=base)
    usable, out.skipped = _usable(case)
    if explained(base) and not base.held > PREDICTS and not violated:
        return out
    first = _singles(case, base, usable, watch, violated)
    if other is not None and _explains_more(other, base, first):
        return None
    out.tried += first
    course = _Course(case=case, base=base, watch=watch, usable=usable, out=out, first=first)
    course.join(first)
    _more_than_one(course, violated)
    if explained(base) and not violated and not any(explained(s) for s in course.good):
        return out
    return _concluded(case, base, course.good, out)


def unless_shifted(case: Case, out: Selection) -> Selection:
    """The verdict, but `unexplained` where what is named is not likelier than a shift of the images that nothing is known of. BIC
    stands for twice the log evidence."""
    if out.verdict == "none":
        return out
    shift, best = latent_shift(case, out.base), out.best or out.base
    if shift is not None and shift.gain > max(0.5 * (out.base.bic - best.bic), BEATS_NOTHING) - BEATS_UNKNOWN:
        out.verdict, out.rivals, out.shift = "unexplained", [], shift
    return out


def _more_than_one(course: _Course, violated: bool) -> None:
    """Longer forms and pairs, where no single effect in its simple form is enough: as the balance of momentum finds them in the
    attitudes, and where it says that nothing acts on the motion, or finds too little, by a search."""
    case, base, first = course.case, course.base, course.first
    leading, far = _nearness(case, first, base, [m for m in course.usable if forms(m) > 1])
    beyond = lost = False

    def ask_balance() -> tuple[bool, bool]:
        # attitudes that show a torque, and nothing in the catalogue explains it: a longer search has no more to try
        by_balance = course.balance()
        none = by_balance.forced and not any(explained(s) for s in course.good)
        return none, none and not by_balance.named

    if not violated and not explained(base) and not any(adequate(s) for s in course.good):
        beyond, lost = ask_balance()
    if not beyond and not any(adequate(s) for s in course.good):
        course.lengthen(leading)
    alone = any(adequate(s) for s in course.good)
    if violated and course.good and not alone:
        course.beside_density()
        if not explained(base) and not any(adequate(s) for s in course.good):
            beyond, lost = ask_balance()
    if course.good and not beyond and not alone:
        course.pair(violated)
    if course.good:
        begun = ([s for s in course.good if explained(s)] or course.good)[0]
        steps = stepwise(case, begun, _beside(begun, course.usable) if lost else course.usable, course.watch)
        course.out.tried += steps
        course.join(steps)
    if not beyond and not any(explained(s) for s in course.good) and (violated or not explained(base)):
        course.lengthen(far)


def _beside(s: FittedModel, usable: list[ModuleType]) -> list[ModuleType]:
    """What may act beside a fit where neither an effect on the motion nor two of them explain the attitudes: one of the two is the
    sensors', which bends the attitudes as well."""
    if any(not changes_motion(a.effect) for a in s.added):
        return usable
    return [m for m in usable if not changes_motion(m)]


def _of_the_motion(case: Case) -> list[ModuleType]:
    """The effects that act on the motion, with what the case knows: those too that only the balance of momentum finds."""
    return [m for m in effects().values() if changes_motion(m) and not lacks(m, set(case.there))]


def _usable(case: Case) -> tuple[list[ModuleType], dict[str, str]]:
    """The effects that the search tries with what the case knows, and by name why others are left out."""
    usable, skipped = [], {}
    for name, module in effects().items():
        if not getattr(module, "SEARCHED", True):
            continue
        missing = lacks(module, set(case.there))
        if missing:
            skipped[name] = missing
        else:
            usable.append(module)
    return usable, skipped


def _singles(
    case: Case, base: FittedModel, usable: list[ModuleType], watch: Watch, violated: bool
) -> list[FittedModel]:
    """Fits of one effect, the best first."""
    first = fit_candidates(case, base, usable, FEWEST_FITS, watch, "one effect")
    if violated and not any(DENSITY in s.names for s in first):
        # what the contradiction itself says, however steep the scores of others from so wrong a model
        density = [m for m in usable if m.NAME == DENSITY]
        first = sorted([*first, *fit_candidates(case, base, density, 1, watch, "one effect")], key=lambda s: s.bic)
    if first and not explained(first[0]) and first[0].fit.iterations >= MOST_ITERATIONS:
        # what leads is seen through to its end before another effect is asked to help
        first[0] = refit(case, first[0].fit.state, first[0].added, most=3 * MOST_ITERATIONS)
    return first


def _concluded(case: Case, base: FittedModel, good: list[FittedModel], out: Selection) -> Selection:
    """The verdict on what may be named, the best first."""
    done = [s for s in good if explained(s)] or [s for s in good if fits(s)][:1]
    while done and not _constant(case, done[0]):
        done = done[1:]
    if done:
        chosen, out.rivals = _decided(case, done)
        out.best = _to_the_end(case, chosen)
        out.verdict = "ambiguous" if out.rivals else "named"
        return out
    if good:
        out.best = good[0] = refit(case, good[0].fit.state, good[0].added, idle=POLISH)
        remaining_square = good[0].fitted ** 2 - 1.0
        nearly = (
            remaining_square < NEARLY * (base.fitted**2 - 1.0)
            and not good[0].held > MISPREDICTED
            and not good[0].implausible
        )
        if nearly and _constant(case, good[0]):
            out.best = _to_the_end(case, good[0])
            out.rivals = _rivals_of(good)
            out.verdict = "ambiguous" if out.rivals else "named"
            return out
    out.verdict = "unexplained"
    return out


def _to_the_end(case: Case, s: FittedModel) -> FittedModel:
    """The model chosen, searched until nothing is gained: its parameters are what is told."""
    return profiled(case, refit(case, s.fit.state, s.added, most=4 * MOST_ITERATIONS, idle=0.1 * POLISH))


def _on_all(case: Case, s: FittedModel) -> FittedModel:
    """The model fitted to the held-out data as well: a right model whose parameters the fitted data leave open predicts
    badly, but explains all."""
    keep = np.zeros_like(case.first.observed)
    for m in (case.fitted, case.held):
        keep[m.seen.epoch, m.seen.camera, m.seen.feature] = True
    every = measurements_of(case.problem, None, keep, case.first.channels)
    return refit(replace(case, fitted=every), s.fit.state, s.added)


def _constant(case: Case, s: FittedModel) -> bool:
    """Whether the held-out data join a model's fit without spoiling it (Chow 1960): a right model whose parameters the
    fitted data leave open predicts badly, but stays right.

    The fit moves by what the held-out data know: chi-square of the fitted data rises by a sum of squares, each weighted
    with the share of all that is known of one direction which the held-out data bring (Satterthwaite's approximation).
    """
    from scipy.special import chdtri  # scipy.stats takes a second to load

    if explained(s) and not s.held > JOINS or not np.isfinite(s.held):
        return True
    whole = _on_all(case, s)
    now = mean_square(residuals(case.problem, case.fitted, whole.fit.predicted))
    rise = count(s.fit.residuals) * (now - s.fitted**2) / max(1.0, s.fitted**2)
    scale = whole.fit.scale
    ours = s.fit.information / scale[:, None] / scale
    share = 1.0 - np.linalg.eigvals(np.linalg.pinv(whole.fit.unit, hermitian=True) @ ours).real
    points = np.full(s.fit.parameters - len(ours), 1.0 - count(s.fit.residuals) / count(whole.fit.residuals))
    share = np.clip(np.concatenate([share, points]), 1e-3, 1.0)
    mean, spread = share.sum(), (share**2).sum()
    return bool(rise * mean / spread < chdtri(mean**2 / spread, SPOILS) and (fits(whole) or not fits(s)))


def _decided(case: Case, done: list[FittedModel]) -> tuple[FittedModel, list[FittedModel]]:
    """The best of the models that explain the fitted data, and its rivals: where BIC does not decide, by all the data."""
    models = distinct(done)
    close = [s for s in models if s.bic - models[0].bic < EVIDENCE and len(s.added) == len(models[0].added)]
    if len(close) == 1:
        return close[0], []
    bic = {s.names: _on_all(case, s).bic for s in close}
    close.sort(key=lambda s: bic[s.names])
    return close[0], [s for s in close[1:] if bic[s.names] - bic[close[0].names] < CLOSE]


def _rivals_of(models: list[FittedModel]) -> list[FittedModel]:
    """Other explanations as good as the first: not the same with something idle besides."""
    best = models[0]
    return [
        s
        for s in distinct(models)
        if s.bic - best.bic < CLOSE and not set(s.names) >= set(best.names) and not set(s.names) <= set(best.names)
    ]


def _explains_more(other: Case, base: FittedModel, first: list[FittedModel]) -> bool:
    """Whether an effect alone explains more in another case than the best does here."""
    good = [s for s in first if acceptable(s, base)]
    if not good or adequate(good[0]):
        return False
    against = good[0].fit.cost
    tried = (refit(other, s.fit.state, s.added, against=against) for s in distinct(good))
    return any(t.bic < good[0].bic - EVIDENCE for t in tried)


def _beam(good: list[FittedModel]) -> list[FittedModel]:
    """The models that a second effect is tried beside: the best, and the best of those without a moment, as an effect that
    begins at any time can follow much that it is not."""
    models = distinct(good)
    smooth = [s for s in models if not any(places_of(a.effect, "time") for a in s.added)]
    first = models[:BEAM]
    return first + [s for s in smooth[:1] if s not in first]


def _nearness(
    case: Case, first: list[FittedModel], base: FittedModel, modules: list[ModuleType]
) -> tuple[list[ModuleType], list[ModuleType]]:
    """The effects whose simple form explains about as much as any other's, and the rest that may be worth more.

    A jump of the tracks that leaves most of the misfit in its simple form is not worth the search over its moment. A
    small record is cheap: there all are near.
    """
    if case.fitted.count <= SMALL or not first:
        return modules, []
    most = base.bic - min(s.bic for s in first)
    best = {m.NAME: min((s for s in first if s.names == (m.NAME,)), key=lambda s: s.bic, default=None) for m in modules}
    leading, far = [], []
    for m in modules:
        s = best[m.NAME]
        much = s is not None and s.fitted**2 - 1.0 < FIRST_SHARE * (base.fitted**2 - 1.0)
        if s is not None and much and base.bic - s.bic > AS_GOOD * most:
            leading.append(m)
        elif much or not moves_at_once(m):
            far.append(m)
    return leading, far


def _longer_forms(
    case: Case, base: FittedModel, module: ModuleType, singles: list[FittedModel], watch: Watch
) -> list[FittedModel]:
    """Fits of an effect's longer forms, from its simple form and from its own starts with the best score."""
    out = []
    if moves_at_once(module):
        # before more is let in: the simple form at the moment that suits it best
        out = [best_event_time(case, s) for s in singles if s.names == (module.NAME,)]
        singles = out
        if any(explained(s) for s in out):
            return out
    for form in range(1, forms(module)):
        added = (Added(module, form),)
        states = [between_epochs(case, s.fit.state, added[0]) for s in singles if s.names == (module.NAME,)]
        if hasattr(module, "longer_starts"):
            offered = [np.array(v, float) for v in module.longer_starts(case.span, case.speed)]
            watch(f"{module.NAME}, form {form + 1}", 0, 1)
            if case.fitted.count <= SMALL:
                # a wrong base model leaves a wrong inertia: begin with a ball as well
                balls = (base.fit.state, replace(base.fit.state, inertia=np.eye(3)))
                begun = [with_effects(b, added, {module.NAME: v}) for b in balls for v in offered]
                short = sorted((refit(case, state, added, most=6) for state in begun), key=lambda s: s.bic)
                states += [s.fit.state for s in short[:FITS_OF_A_FORM]]
            else:
                offered = offered[:: max(1, len(offered) // MOST_SCORES)]
                tests = sorted(score_tests(case, base, [(added[0], v) for v in offered]), key=lambda t: -t.gain)
                states += [
                    with_effects(base.fit.state, added, {module.NAME: t.start}) for t in tests[: FITS_OF_A_FORM // 2]
                ]
        small = case.fitted.count <= SMALL
        least = np.inf if small else near(min((s.fit.cost for s in singles), default=np.inf))
        refitted = [refit(case, state, added, most=40 if small else 20, against=least) for state in states]
        out += [s if explained(s) else best_event_time(case, s) for s in refitted]
    return out
