"""Hooks of mkdocs: pages that are made from the code, whenever the documentation is built."""

from __future__ import annotations

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import commands
import effect_pages
import gallery_pages
import method_pages
import paper_pages
import python_pages
from mkdocs.structure.files import File, Files

MAKERS = (effect_pages, method_pages, paper_pages, python_pages, commands, gallery_pages)


def on_config(config):
    """Puts the generated pages where the navigation names their section."""
    sections = {maker.SECTION: maker for maker in MAKERS if hasattr(maker, "SECTION")}
    for entry in config["nav"]:
        for title, pages in entry.items():
            if title in sections and isinstance(pages, list):
                pages += sections[title].nav()
    return config


def on_files(files: Files, config) -> Files:
    """Adds the generated pages and pictures."""
    for maker in MAKERS:
        for path, content in maker.pages().items():
            files.append(File.generated(config, path, content=content))
    sample = Path(config["config_file_path"]).parent / "samples" / "report.png"
    files.append(File.generated(config, "report.png", content=sample.read_bytes()))
    changes = (Path(config["config_file_path"]).parent / "CHANGELOG.md").read_text()
    files.append(File.generated(config, "changelog.md", content=changes))
    return files


def on_post_page(output: str, page, config) -> str:
    """Leaves out the one script that the theme would fetch from elsewhere: the pages ask for nothing outside."""
    return re.sub(r'<script src="https://unpkg\.com/[^"]*"></script>', "", output)
