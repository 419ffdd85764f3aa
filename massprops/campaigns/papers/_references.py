"""Where each paper was published."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Reference:
    """Of one paper.

    Attributes:
        journal: with volume and page. doi: empty where none was seen on the paper or its publisher's page.
    """

    authors: str
    title: str
    journal: str
    year: int
    doi: str = ""
