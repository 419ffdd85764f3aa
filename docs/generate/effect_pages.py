"""One page an effect: what its file says of it, and a plot of what it does to the tracks and the rotation."""

from __future__ import annotations

import io

import numpy as np

import massprops
from massprops.effects import changes_motion, effects

SECTION = "Effects"
PIXELS = 6


def nav() -> list[dict[str, str]]:
    return [{name: f"catalogue/{name}.md"} for name in effects()]


def pages() -> dict[str, str | bytes]:
    made: dict[str, str | bytes] = {"catalogue/index.md": overview()}
    plain = seen(())
    for name, effect in effects().items():
        if "mesh" not in effect.NEEDS:  # a scenario of tracks has none
            made[f"catalogue/{name}.svg"] = plot(plain, seen((f"{name}:{PIXELS}",)))
        made[f"catalogue/{name}.md"] = page(name, effect)
    return made


def overview() -> str:
    lines = [
        "# Effects",
        "",
        "These effects can act on a free body, or on the sensors that watch it. `massprops simulate --effects NAME:PIXELS` "
        "switches one on, and `massprops diagnose` finds it. The pages are generated from the files of the effects. "
        "[Your own effects](../effects.md) are such files too.",
        "",
        "| effect | acts on | |",
        "|---|---|---|",
    ]
    for name, effect in effects().items():
        lines.append(
            f"| [{name}]({name}.md) | {'motion' if changes_motion(effect) else 'sensors'} | {effect.SENTENCE} |"
        )
    return "\n".join(lines) + "\n"


def page(name: str, effect) -> str:
    note = getattr(effect, "NOTE", "")
    rows = "\n".join(f"| `{q.name}` | {q.unit or '–'} | {q.kind} |" for q in effect.PARAMETERS)
    needs = ", ".join(effect.NEEDS) or "nothing except the motion"
    acts = "the body's motion" if changes_motion(effect) else "what the sensors measure"
    return f"""# {name}

{effect.SENTENCE}

It acts on {acts}. It needs: {needs}.

    {effect.FORMULA}

Here `w` are the body rates. Torques and momenta are divided by the body's mean moment of inertia, as motion alone shows only ratios.

| parameter | unit | kind |
|---|---|---|
{rows}

{note}

{"It acts on the faces of a run's own mesh: `massprops diagnose RUN -o diagnosis`." if "mesh" in effect.NEEDS else shown(name)}
"""


def shown(name: str) -> str:
    return f"""![What {name} does]({name}.svg)

Above: how far the effect moves the tracks (root mean square over the points at each epoch), for a tumbling body 9 m away, seen
by two cameras with a focal length of 1000 px. The size of the effect was chosen so that the overall value is {PIXELS} px.
Below: the true angular velocity with the effect (lines) and without it (dots).

    massprops simulate tracks -o seq --effects {name}:{PIXELS}
    massprops diagnose seq -o diagnosis"""


def seen(active: tuple[str, ...]):
    """The same body and noise with and without an effect."""
    return massprops.simulate("tracks", frames=240, sigma=0.0, effects=active or None, seed=4)


def plot(plain, acted) -> bytes:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    matplotlib.rcParams["svg.hashsalt"] = "massprops"
    times, moved = displacement(plain, acted)
    figure, (above, below) = plt.subplots(2, 1, figsize=(7, 4.2), sharex=True, constrained_layout=True)
    above.plot(times, moved, color="#1f5f99")
    above.set_ylabel("tracks moved [px]")
    truth = acted.truth
    t = (truth.timestamp_ns - truth.timestamp_ns[0]) * 1e-9
    for axis, colour in enumerate(("#b5403a", "#3a7d44", "#1f5f99")):
        below.plot(t, np.degrees(truth.w[:, axis]), color=colour, lw=1.2, label="xyz"[axis])
        below.plot(t[::6], np.degrees(plain.truth.w[::6, axis]), ".", color=colour, ms=3)
    below.set_ylabel("rate [deg/s]")
    below.set_xlabel("time [s]")
    below.legend(ncols=3, loc="upper right", fontsize=8)
    file = io.BytesIO()
    figure.savefig(file, format="svg", metadata={"Date": None})
    plt.close(figure)
    return file.getvalue()


def displacement(plain, acted) -> tuple[np.ndarray, np.ndarray]:
    """Root mean square over the points that both show, at each epoch."""
    first, second = ({key: uv for key, uv in rows(s)} for s in (plain.sequence.tracks, acted.sequence.tracks))
    squares: dict[int, list[float]] = {}
    for key, uv in second.items():
        if key in first:
            squares.setdefault(key[0], []).append(float(np.sum((uv - first[key]) ** 2)))
    stamps = sorted(squares)
    return (np.array(stamps) - stamps[0]) * 1e-9, np.sqrt([np.mean(squares[s]) for s in stamps])


def rows(tracks):
    keys = zip(tracks.timestamp_ns.tolist(), tracks.camera.tolist(), tracks.feature.tolist(), strict=True)
    return zip(keys, tracks.uv, strict=True)
