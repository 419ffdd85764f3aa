"""A law as an effect file: text that `massprops --effect` reads, and the same text at work here."""

from __future__ import annotations

from types import ModuleType

from massprops.diagnosis.discovery.library import HELPERS, NEED, PRELUDE, UNIT, LibraryTerm, letters_of

NAME = "discovered-law"


def source_of(terms: tuple[LibraryTerm, ...], sizes: list[float]) -> str:
    """The effect file of a law; sizes: of its coefficients, by which a search for them is scaled."""
    every = tuple(x for term in terms for x in term.torque)
    letters = letters_of(every)
    text = " ".join(every)
    needs = tuple(NEED[letter] for letter in sorted(letters) if letter in NEED)
    names = ["c" + str(k + 1) for k in range(len(terms))]
    lines = [
        '"""A law that `massprops diagnose --discover` found."""',
        "",
        *(["import numpy as np", ""] if "np." in text else []),
        *(["from massprops.dynamics.kernels import to_body"] if letters - {"w"} else []),
        "from massprops.effects import Parameter",
        "",
        f'NAME = "{NAME}"',
        'SENTENCE = "A torque that was discovered in a record."',
        f'FORMULA = "torque = {" + ".join(f"{n} [{t.label}]" for n, t in zip(names, terms, strict=True))}"',
        "PARAMETERS = (",
    ]
    for name, term, value in zip(names, terms, sizes, strict=True):
        label = " or ".join((term.label, *term.same))
        lines.append(f'    Parameter("{name}", "{term.unit}", {max(abs(value), 1e-12):.3g}),  # {label}')
    lines += [")", f"NEEDS = {needs!r}", "", ""]
    if any(f"{helper}(" in text for helper in ("lit", "size", "begun")):
        lines += [HELPERS.rstrip(), "", ""]
    if letters & {"b", "n"}:
        lines += [UNIT.rstrip(), "", ""]
    lines += [
        "def torque(t, q, w, p, inertia, environment):",
        '    """Over the mean moment, body axes [rad/s^2]."""',
        *(f"    {PRELUDE[letter]}" for letter in sorted(letters)),
        "    nothing = 0.0 * t + 0.0 * p[0]",
        "    return (",
    ]
    for i in range(3):
        parts = [f"p[{k}] * ({term.torque[i]})" for k, term in enumerate(terms) if term.torque[i] != "0.0"]
        lines.append("        " + " + ".join(["nothing", *parts]) + ",")
    lines += ["    )", ""]
    return "\n".join(lines)


def effect_of(source: str) -> ModuleType:
    """The effect of such a text."""
    module = ModuleType("massprops_discovered_law")
    exec(compile(source, "law.py", "exec"), module.__dict__)  # noqa: S102  text of our own making
    return module
