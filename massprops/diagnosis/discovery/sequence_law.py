"""The law of a sequence: found in its record of the balance, and the files that a law leaves."""

from __future__ import annotations

from typing import Any

from massprops.diagnosis.discovery.law import Law, discover, document_of_law, model_of_law
from massprops.diagnosis.sequence_record import record_of_sequence
from massprops.sequence.data import Sequence


def law_of_sequence(sequence: Sequence) -> Law | None:
    """The law that a sequence asks for, or None.

    Raises:
        NotPossible: nothing shows the rotation, or the fits lead nowhere.
    """
    from massprops.diagnosis.selection import without_effects

    record = record_of_sequence(sequence)
    base, unknown = without_effects(record)
    return None if unknown is base else discover(record, base, unknown)


def files_of_law(law: Law | None) -> tuple[dict[str, Any], dict[str, str | bytes]]:
    """What `diagnosis.json` says of a law, and its files by name."""
    import yaml

    from massprops.core.files import plain

    document = document_of_law(law)
    if law is None:
        return document, {}
    model = yaml.safe_dump(plain(model_of_law(law)), sort_keys=False, allow_unicode=True)
    return document, {"law.py": law.source, "law.yaml": model}
