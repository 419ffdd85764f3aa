"""`massprops diagnose`: where simulation and measurement disagree, and what is missing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from massprops import diagnose
from massprops.core.text import table
from massprops.errors import NotPossible
from massprops_cli.options import Force, Quiet, argument, as_json, defaults, option, takes
from massprops_cli.terminal import say, warn

D = defaults(diagnose)


@dataclass(frozen=True)
class Options:
    source: Annotated[Path | None, argument(diagnose, "source", "[SEQ_OR_RUN]")] = None
    more: Annotated[list[Path] | None, argument(diagnose, "more", "[MORE]...")] = None
    out: Annotated[Path | None, option(diagnose, "out", "-o", "--out")] = D.out
    discover: Annotated[bool, option(diagnose, "discover", "--discover")] = D.discover
    simulator: Annotated[str | None, option(diagnose, "simulator", "--simulator", metavar="MODULE:FUNCTION")] = (
        D.simulator
    )
    design: Annotated[
        str | None,
        typer.Option(
            "--design",
            metavar="SCENARIO",
            help="Instead of SEQ_OR_RUN, a planned recording: 'tracks', or a YAML file as for 'simulate'. Tells which effects "
            "of which size it could show and tell apart.",
        ),
    ] = None
    effect: Annotated[list[Path] | None, option(diagnose, "effect", metavar="FILE")] = D.effect
    force: Force = False
    json_output: Annotated[bool, as_json("diagnosis.json")] = False
    quiet: Quiet = False


@takes(Options)
def command(given: Options) -> int:
    """Find where a recorded motion departs from that of a free rigid body, and name the effect that is missing.

    The result is printed. With -o it is also written to a folder, with the model, the residuals and a report. The exit code is 3 if
    the body turns too little to show whether an effect is missing.

    Example: massprops diagnose sequences/one -o diagnoses/one

    Example: massprops diagnose --design planned.yaml
    """
    from massprops.errors import InputError

    if (given.source is None) == (given.design is None):
        raise InputError("give either a sequence or run folder, or --design SCENARIO")
    if given.design is not None:
        return _design(given.design, given.out, given.effect or [], given.force, given.json_output)
    assert given.source is not None
    if given.more:
        if given.discover or given.simulator is not None:
            from massprops.diagnosis.several import ONE_RECORD

            raise InputError(ONE_RECORD)
        return _several(given, [given.source, *given.more])
    return _one(given, given.source)


def _one(given: Options, source: Path) -> int:
    """One record, printed, and kept where a folder is given."""
    import json

    from massprops.core.files import plain
    from massprops.diagnosis.document import is_blind
    from massprops.diagnosis.search import diagnose
    from massprops.effect_file import with_effects
    from massprops_cli.progress import StageProgress

    out = given.out
    with with_effects(given.effect or []), StageProgress(given.quiet) as watch:
        tell = lambda what, done, total: watch(what, 0, 1, done, total, "")  # noqa: E731
        diagnosis = diagnose(source, out, tell, given.force, given.discover, given.simulator)
    for warning in diagnosis.document["warnings"]:
        warn(warning)
    if given.effect and "would fix them" in diagnosis.document["axes"]:
        warn(f"{diagnosis.document['axes']}: an effect of your own that has a direction in the body acts in these axes")
    if given.json_output:
        say((out / "diagnosis.json").read_text() if out is not None else json.dumps(plain(diagnosis.document)))
    else:
        say(diagnosis_table(diagnosis.document))
        if out is not None:
            say(f"report: {out / 'report.html'}")
    return NotPossible.exit_code if is_blind(diagnosis.document) else 0


def _several(given: Options, sources: list[Path]) -> int:
    """Several records of one body, printed, and kept in `diagnosis.json`."""
    import json

    from massprops.core.files import plain
    from massprops.diagnosis.diagnose import diagnose_several, write_several
    from massprops.diagnosis.document import is_blind
    from massprops.diagnosis.several_document import turn_words
    from massprops.effect_file import with_effects
    from massprops.effects import effects
    from massprops.sequence.read import read_sequence
    from massprops_cli.progress import StageProgress

    with with_effects(given.effect or []), StageProgress(given.quiet) as watch:
        document = diagnose_several(
            {str(s): read_sequence(s) for s in sources}, lambda what, done, total: watch(what, 0, 1, done, total, "")
        )
        known = effects()
    if given.out is not None:
        write_several(document, given.out, sources, given.force)
    for warning in document["warnings"]:
        warn(warning)
    rows = [f"  verdict   {document['verdict']}: {document['reason']}"]
    for effect in document["effects"]:
        rows.append(f"  {effect['name']}  (log evidence {effect['evidence']:+.0f})")
        for name, parameters in effect["parameters"].items():
            units = {q.name: q.unit for q in known[name].PARAMETERS} if name in known else {}
            rows += _parameter_rows(parameters, effect["sigma"][name], dict.fromkeys(parameters, "") | units)
    rows += [f"  {k}  {document[k]['value']:.4f} ± {document[k]['sigma']:.2g}" for k in ("k1", "k2")]
    rows += [f"  axes of {t['record']}  turned by {turn_words(t)}" for t in document["turned"]]
    rows += [
        f"  {name}: {d['verdict']} {', '.join(e['name'] for e in d['effects'])}"
        for name, d in document["records"].items()
    ]
    say(json.dumps(plain(document)) if given.json_output else "\n".join(rows))
    return NotPossible.exit_code if is_blind(document) else 0


def diagnosis_table(document: dict[str, Any]) -> str:
    """A few lines: verdict, effects with their parameters, the gap."""
    names = ", ".join(dict.fromkeys(e["name"] for e in document["effects"]))
    rows = [f"  verdict   {document['verdict']}{': ' + names if names else ''}. {document['reason']}"]
    for effect in document["effects"]:
        gain = effect["held_out_gain"]
        held = "nothing held out" if gain is None else f"held-out gain {gain:+.2f}"
        rows.append(f"  {effect['name']}  (BIC {effect['delta_bic']:+.0f}, {held})")
        rows += _parameter_rows(effect["parameters"], effect["sigma"], effect["units"])
    if document["effects"] and "axes" in document:
        rows.append(f"  {document['axes']}")
    if "simulator" in document:
        rows += _simulator_rows(document["simulator"])
    if "law" in document:
        rows += _law_rows(document["law"])
    gap = document["gap"]
    residual_rows = []
    for part in ("fitted", "held_out"):
        both = (gap[part][k] for k in ("before", "after"))
        residual_rows.append([part.replace("_", " "), *(f"{v:.3f}" if v is not None and v == v else "–" for v in both)])
    rows += table(("residual / noise", "before", "after"), residual_rows)
    # where nothing is missing, what stands out most is chance
    for place in document["where"][:3] if document["verdict"] != "none" else ():
        a, b = place["interval_s"]
        size = f"{place['size']:.3g} times the noise"
        rows.append(f"  departs from a free body: {_place(place)}, {a:.4g} to {b:.4g} s, {size}")
    rows += _torque_rows(document)
    return "\n".join(rows)


def _parameter_rows(values: dict[str, Any], sigma: dict[str, Any], units: dict[str, str]) -> list[str]:
    """One line for each parameter that the data show, and one with the names of the others."""
    from massprops.diagnosis.listed import listed

    listing = listed(values)
    rows = []
    for name in listing.rows:
        spread = f"± {sigma[name]:<10.2g}" if sigma[name] else " " * 12
        rows.append(f"    {name:<14}{values[name]:>14.5g} {spread} {units[name]}")
    if listing.more:
        rows.append(f"    and {listing.more} more in diagnosis.json")
    if listing.hidden:
        rows.append(f"    not measurable: {listing.hidden}")
    return rows


def _torque_rows(document: dict[str, Any]) -> list[str]:
    """The torque that would explain what no effect does, and what it goes along with."""
    torque = document.get("latent")
    if torque is None or document["verdict"] != "unexplained":
        return []
    alike = [f"{c['with'].replace(' by ', ' with ')} (r = {c['r']:+.2f})" for c in torque["correlates"][:1]]
    magnitude = f"{torque['shown_rms']:.2g} ± {torque['shown_sigma']:.1g} rad s^-2 rms"
    return [f"  unknown torque: {magnitude}{', goes along: ' if alike else ''}{''.join(alike)}"]


def _place(place: dict[str, Any]) -> str:
    """What was measured where, in words."""
    camera, _, axis = place["channel"].partition(" ")
    if axis in ("u", "v"):
        return f"{'columns' if axis == 'u' else 'rows'} of the pixels in {camera}"
    if place.get("direction"):
        return f"features on the {place['direction']} side of the body"
    if place["features"]:
        return f"feature {place['features'][0]}"
    return f"a part of the image of {camera}" if "region" in place else str(place["channel"])


def _law_rows(law: dict[str, Any]) -> list[str]:
    """The law that was discovered, term by term."""
    if law["formula"] is None:
        return [f"  law       none: {law['because']}"]
    rows = [f"  law       {law['formula']}" + ("" if law["stated"] else f"  (uncertain: {law['because']})")]
    for t in law["terms"]:
        same = f" (the same in this record: {', '.join(t['same_here'])})" if t["same_here"] else ""
        rows.append(
            f"    {t['coefficient']:>12.4g} ± {t['sigma']:<9.2g} {t['unit']:<10} {t['term']}{same}, probability {t['probability']:.2f}"
        )
    rows += [f"    nearly as likely ({r['log_evidence']:+.1f}): {' + '.join(r['terms'])}" for r in law["rivals"][:3]]
    beside = law["catalogue"]
    if beside is not None:
        rows.append(
            f"    over {' + '.join(beside['effects'])} of the catalogue: {beside['log_evidence']:+.1f} in log evidence"
        )
    held = law["held_out"]
    if held["after"] is not None:
        rows.append(
            f"    held-out residuals: {held['before']:.2f} times the noise without the law, {held['after']:.2f} with it"
        )
    return rows


def _simulator_rows(box: dict[str, Any]) -> list[str]:
    """A user's simulator: what it leaves, and its parameters."""
    rows = [
        f"  simulator {box['name']} leaves residuals of {box['fitted']:.2f} times the noise, {box['held_out']:.2f} in held-out data"
    ]
    return rows + _parameter_rows(box["parameters"], box["sigma"], box["units"])


def _design(scenario: str, out: Path | None, effects: list[Path], force: bool, json_output: bool) -> int:
    """What a planned record could show, printed, and kept in `design.json`."""
    import json

    from massprops.core.files import json_text
    from massprops.core.outputs import deliver
    from massprops.diagnosis.design import design
    from massprops.effect_file import with_effects

    with with_effects(effects):
        document = design(scenario)
    if out is not None:
        deliver(out, "diagnose --design", {"design.json": json_text(document)}, None, [], force)
    say(json.dumps(document) if json_output else design_table(document))
    return 0


def design_table(document: dict[str, Any]) -> str:
    """Effects with the sizes from which they show, what each is taken for, and what would help."""
    rows = [
        f"  {document['epochs']} epochs over {document['seconds']:.4g} s, {document['measured']} ± {document['sigma']:.2g}"
    ]
    listed = []
    for e in document["effects"]:
        shows = "never" if e["shows_from"] is None else f"{e['shows_from']:.2g}"
        apart = document["told_apart"][e["name"]]
        near = [n for n, f in apart.items() if f is None or f > document["apart_up_to"]]
        rest = max((f for n, f in apart.items() if n not in near), default=1.0)
        listed.append([e["name"], shows, e["unit"], f"{rest:.1f}  {', '.join(near) or '-'}"])
    told = "told apart from all others at this multiple, except from"
    rows += table(("effect", "visible from", "unit", told), listed, left=(0, 2, 3))
    for h in document["would_help"]:
        if h["tells_apart"]:
            pairs = ", ".join(" from ".join(p) for p in h["tells_apart"][:6])
            rows.append(f"  {h['change']} would tell apart {pairs}")
    for name, why in document["skipped"].items():
        rows.append(f"  {name} left out: {why}")
    return "\n".join(rows)
