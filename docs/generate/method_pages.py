"""One page an estimator, from its file, with its answer on one recording against the truth."""

from __future__ import annotations

import inspect
import io
import re

import numpy as np

import massprops
from massprops.campaigns.papers import references
from massprops.estimators.methods import methods
from massprops.estimators.needs import SAID

SECTION = "Estimators"


def nav() -> list[dict[str, str]]:
    return [{name: f"methods/{name}.md"} for name in methods()]


def pages() -> dict[str, str | bytes]:
    seen = massprops.simulate("tracks", frames=240, attitude=2e-3, range=0.02, seed=3)
    found = {e.name: e for e in massprops.estimate(seen)}
    made: dict[str, str | bytes] = {"methods/index.md": overview(found, seen.truth.facts)}
    for name, method in methods().items():
        made[f"methods/{name}.md"] = page(name, method, found.get(name), seen.truth.facts)
        if name in found and found[name].w is not None:
            made[f"methods/{name}.svg"] = plot(found[name], seen.truth)
    return made


def overview(found, facts) -> str:
    lines = [
        "# Estimators",
        "",
        "Each estimator computes the inertia ratios and the motion from measurements of a free body. `massprops estimate "
        "SEQ` runs all that the data allow, `--method NAME` runs one. The smoother is the reference: it uses all data at "
        "once. The others are the filters of the papers, corrected where necessary. The pages are generated from their files.",
        "",
        f"On one simulated recording (240 stereo frames, k1 = {facts['k1']:.4f}, k2 = {facts['k2']:.4f}):",
        "",
        "| estimator | reads | k1 | k2 | |",
        "|---|---|---|---|---|",
    ]
    for name, method in methods().items():
        one = found.get(name)
        k = ("–", "–") if one is None or one.k1 is None else (value(one, "k1"), value(one, "k2"))
        lines.append(f"| [{name}]({name}.md) | {needs(method)} | {k[0]} | {k[1]} | {sentence(method)} |")
    return "\n".join(lines) + "\n"


def page(name: str, method, one, facts) -> str:
    head = inspect.getdoc(method).split("\n", 1)
    more = head[1].strip() if len(head) > 1 else ""
    said = [f"# {name}", "", sentence(method)[:1].upper() + sentence(method)[1:], "", f"Reads: {needs(method)}.", ""]
    if more:
        said += [more, ""]
    for key, reference in references().items():
        if re.search(key, f"{head[0]} {sentence(method)} {more}"):
            said += [
                f"Based on {reference.authors}, *{reference.title}*: see [the papers](../papers.md#{key}).",
                "",
            ]
    if one is not None and one.k1 is not None:
        said += [
            "| on one simulated recording | k1 | k2 |",
            "|---|---|---|",
            f"| {name} | {value(one, 'k1')} | {value(one, 'k2')} |",
            f"| truth | {facts['k1']:.5f} | {facts['k2']:.5f} |",
            "",
        ]
    if one is not None and one.w is not None:
        said += [
            f"![Its angular velocity against the truth]({name}.svg)",
            "",
            "Error of the magnitude of the angular velocity. Shaded: three times the stated 1-sigma error, all axes together.",
            "",
        ]
    return "\n".join(said)


def needs(method) -> str:
    entries = [method.NEEDS] if isinstance(method.NEEDS, str) else method.NEEDS
    return "; ".join(" or ".join(SAID[w] for w in re.split(r"[^a-z]+", entry) if w in SAID) for entry in entries)


def sentence(method) -> str:
    return method.SENTENCE.rstrip(".") + "."


def value(one, name: str) -> str:
    low, high = one.interval.get(name, (np.nan, np.nan))
    return f"{getattr(one, name):.5f} ± {(high - low) / 2 / 1.6449:.1g}"


def plot(one, truth) -> bytes:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    matplotlib.rcParams["svg.hashsalt"] = "massprops"
    speed = np.linalg.norm(one.w, axis=1)
    true = np.interp(one.times, (truth.timestamp_ns - truth.timestamp_ns[0]) * 1e-9, np.linalg.norm(truth.w, axis=1))
    figure, axes = plt.subplots(figsize=(7, 2.6), constrained_layout=True)
    axes.plot(one.times, 1e3 * np.degrees(speed - true), color="#1f5f99", lw=1)
    if one.sigma_w is not None:
        sigma = 3e3 * np.degrees(np.linalg.norm(one.sigma_w, axis=1))
        axes.fill_between(one.times, -sigma, sigma, color="#1f5f99", alpha=0.15, lw=0)
        reach = np.nanpercentile(sigma, 80)
        axes.set_ylim(-1.5 * reach, 1.5 * reach)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("error of the rate [mdeg/s]")
    file = io.BytesIO()
    figure.savefig(file, format="svg", metadata={"Date": None})
    plt.close(figure)
    return file.getvalue()
