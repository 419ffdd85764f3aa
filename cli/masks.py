"""`massprops masks`: a run's silhouettes, to look at and to mend."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from massprops import masks
from massprops_cli.options import argument, as_json, defaults, option
from massprops_cli.terminal import say

D = defaults(masks)


def command(
    run: Annotated[Path, argument(masks, "run", "RUN")],
    out: Annotated[Path | None, option(masks, "out", "-o", "--out")] = D.out,
    force: Annotated[bool, option(masks, "force", "--force")] = D.force,
    show: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    json_output: Annotated[bool, as_json("the list of images")] = False,
) -> None:
    """Write a run's silhouettes as images that you can correct, and a page that shows them.

    Each mask has the size of its image and is named as COLMAP names it, NAME.png. Correct what is wrong in any editor,
    then give the folder back: massprops reconstruct IMAGES --masks FOLDER.

    Example: massprops masks runs/one -o one-masks --open
    """
    import json
    from dataclasses import asdict

    from massprops.run.masks import masks

    sheet = masks(run, out, force)
    if json_output:
        say(json.dumps({"folder": str(sheet.folder), "images": [asdict(s) for s in sheet.images]}))
        return
    used = [s for s in sheet.images if not s.left_out]
    known = sorted(s.iou for s in used if s.iou is not None)
    say(f"{len(sheet.images)} masks in {sheet.folder}; {len(used)} of them were used for the shape")
    if known:
        say(f"agreement with the mesh: median {known[len(known) // 2]:.3f}, worst {known[0]:.3f}")
    if show:
        import webbrowser

        webbrowser.open(sheet.page.as_uri())
    say(f"page: {sheet.page}")
