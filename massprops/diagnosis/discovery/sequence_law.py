"""The law of a sequence: found in its record of the balance, and the files that a law leaves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from massprops.diagnosis.candidate import Selection
from massprops.diagnosis.discovery.law import Law, discover, document_of_law, model_of_law
from massprops.diagnosis.sequence_record import record_of_sequence
from massprops.sequence.data import Sequence


def law_of_sequence(sequence: Sequence, named: Selection | str | None = None) -> Law | None:
    """The law that a sequence asks for, or None.

    Args:
        named: what the catalogue names there: a selection by the balance of momentum, or the one effect of a search over starts.

    Raises:
        NotPossible: nothing shows the rotation, or the fits lead nowhere.
    """
    from massprops.diagnosis.discovery.beside_catalogue import against_name, against_selection
    from massprops.diagnosis.unnamed import without_effects

    record = record_of_sequence(sequence)
    base, unknown = without_effects(record)
    law = None if unknown is base else discover(record, base, unknown)
    if law is None or named is None:
        return law
    return replace(law, catalogue=against_name(law, named) if isinstance(named, str) else against_selection(law, named))


def files_of_law(law: Law | None) -> tuple[dict[str, Any], dict[str, str | bytes]]:
    """What `diagnosis.json` says of a law, and its files by name."""
    import yaml

    from massprops.core.files import plain

    document = document_of_law(law)
    if law is None:
        return document, {}
    model = yaml.safe_dump(plain(model_of_law(law)), sort_keys=False, allow_unicode=True)
    return document, {"law.py": law.source, "law.yaml": model}
