"""The judgements of many scenes as text."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tabletop.judge import Judgement

HEAD = (
    f"  {'scene':<16} exit conf   agree/placed/all closed  volume      I/V^(5/3)            dk1    dk2  centre strays"
    "  IoU median worst  90 % fails        half    CPU"
)


def line(name: str, found: Judgement) -> str:
    """One scene in one line; lengths over the greatest extent, errors in per cent, CPU in seconds."""
    shape = " ".join(f"{100 * v:+6.1f}" for v in found.shape)
    fails = " ".join(q for q, ok in found.holds.items() if not ok) or ("none" if found.holds else "-")
    both = ""
    if found.together is not None:
        volume, numbers, k = found.together
        row = " ".join(f"{100 * v:+6.1f}" for v in numbers)
        both = f"\n  {'with the motion':<47} {100 * volume:+7.2f} {row} {k[0]:+6.3f} {k[1]:+6.3f}"
    return (
        f"  {name:<16} {found.exit_code:>4} {found.confidence or '-':<6} "
        f"{found.agree:>5}/{found.registered:>3}/{found.images:>3}    {'yes' if found.closed else 'no':<6} "
        f"{100 * found.volume:+7.2f} {shape} {found.k[0]:+6.3f} {found.k[1]:+6.3f} {100 * found.centre:6.2f} "
        f"{100 * found.strays:6.2f}      {found.iou_median:.3f} {found.iou_worst:.3f}  {fails:<16} "
        f"{100 * found.half_width:5.1f} {found.cpu_seconds:6.0f}{both}"
    )


def summary(title: str, found: Mapping[str, Judgement]) -> list[str]:
    """A heading, a line a scene, and the medians over the scenes that gave a closed body."""
    done = [j for j in found.values() if j.closed]
    lines = ["", title, HEAD, *(line(name, j) for name, j in sorted(found.items()))]
    if done:
        volume = np.abs([j.volume for j in done])
        lines.append(
            f"  {len(done)} of {len(found)} closed; |volume| median {100 * np.nanmedian(volume):.2f} %, worst "
            f"{100 * np.nanmax(volume):.2f} %; IoU median {np.nanmedian([j.iou_median for j in done]):.3f}; interval of "
            f"the volume holds in {sum(j.holds.get('volume', False) for j in done)}"
        )
    return lines
