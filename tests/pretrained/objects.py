"""A small model in the form in which one ships."""

import json
from pathlib import Path

from fauna.pretrained import shipped
from tests.runs import reference_run


def ship(folder: Path, monkeypatch) -> Path:
    """Put the reference run's weights where the package looks for its model."""
    folder.mkdir(parents=True, exist_ok=True)
    content = (reference_run() / shipped.WEIGHTS).read_bytes()
    (folder / shipped.WEIGHTS).write_bytes(content)
    (folder / shipped.CARD).write_text("# A card\n")
    digests = {name: shipped.sha256((folder / name).read_bytes()) for name in (shipped.WEIGHTS, shipped.CARD)}
    (folder / shipped.INDEX).write_text(json.dumps({"files": digests}))
    monkeypatch.setattr(shipped, "_folder", lambda: folder)
    return folder
