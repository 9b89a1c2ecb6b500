"""The files of a morph and of a transferred pose. ``result.json`` comes last: where it is, everything else is."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from fauna.export import write_glb
from fauna.export.animal import RiggedAnimal
from fauna.io.contact_sheet import save_png
from fauna.io.run_folder import write_json
from fauna.plots.bodies import Look, body_views, photographed, sheet, stacked, tile
from fauna.reconstruct.clock import Clock
from fauna.reconstruct.morph import Morph
from fauna.reconstruct.outputs import PREVIEW, RESULT, write_models
from fauna.reconstruct.pair import Pair
from fauna.reconstruct.posing import PoseTransfer
from fauna.reconstruct.report import angles, report
from fauna.reconstruct.result import Fit
from fauna.viewer.video import video_suffix, write_video

FILM, FPS = "morph", 16
VIEWS = 4
"""Of a transferred pose in ``preview.png``."""


def write_morph(morph: Morph, folder: Path, **extra: object) -> None:
    """Write contact sheet, film, key frames and ``result.json`` into an existing folder.

    Args:
        morph: also one without two animals; then ``result.json`` alone is written.
        folder: where to.
        extra: further keys of ``result.json``.
    """
    clock, files, keys = Clock(), [], []
    clock.seconds = dict(morph.seconds)
    if morph.first.fit is not None and morph.second.fit is not None:
        settings = morph.first.settings.morph
        for share in np.linspace(0.0, 1.0, settings.keys).tolist():
            with clock.stage("key_frames"):
                animal = morph.rigged(share)
                name = f"model_{round(100 * share):03d}.glb"
                write_glb(animal, folder / name)
            files.append(name)
            keys.append({"file": name, "share": round(share, 4), "vertices": len(animal.vertices)})
        with clock.stage("preview"):
            save_png(morph_sheet(morph, columns=settings.columns, cell=settings.cell), folder / PREVIEW)
        with clock.stage("film"):
            film = folder / f"{FILM}{video_suffix()}"
            write_video(film, morph_film(morph, size=settings.film_size), fps=FPS)
        files += [PREVIEW, film.name]
    facts = {"kind": "morph", "frames": morph.frames, "key_frames": keys}
    _write_result(morph, facts, folder, clock, files, extra)


def write_transfer(transfer: PoseTransfer, folder: Path, **extra: object) -> None:
    """Write model, viewer, turntable, preview and ``result.json`` into an existing folder.

    Args:
        transfer: also one without two animals; then ``result.json`` alone is written.
        folder: where to.
        extra: further keys of ``result.json``.
    """
    clock, files, facts = Clock(), [], {"kind": "pose", "bone_angles": None}
    clock.seconds = dict(transfer.seconds)
    if transfer.first.fit is not None and transfer.second.fit is not None:
        with clock.stage("texture"):
            _ = transfer.first.texture
        with clock.stage("rig"):
            animal = transfer.rigged()
        said = {"shape and colours": transfer.first.name, "pose": transfer.second.name}
        output = transfer.first.settings.output
        files = write_models(animal, output, folder, clock, title=transfer.name, facts=said, poster=None, clip=None)
        with clock.stage("preview"):
            save_png(transfer_sheet(transfer, animal, cell=output.preview_cell), folder / PREVIEW)
        files.append(PREVIEW)
        assert transfer.out.pose is not None
        facts["bone_angles"] = angles(transfer.out.pose.angles[0])
    _write_result(transfer, facts, folder, clock, files, extra)


def morph_sheet(morph: Morph, *, columns: int, cell: int) -> Image.Image:
    """Photographs; bodies between them in colour, in clay and as resting base shapes, all steps of a row at one scale.

    Args:
        morph: with two animals.
        columns: steps shown.
        cell: side of a picture, pixels.
    """
    shares = np.linspace(0.0, 1.0, columns).tolist()
    looks = [morph.look(share) for share in shares]
    bases = [morph.base(share).base for share in shares]
    rows = {
        "shape, pose and colours": looks,
        "shape and pose": [Look(each.verts, each.faces) for each in looks],
        "base shapes of the bank, at rest": [Look(each.verts, each.faces).grounded() for each in bases],
    }
    steps = [f"{100 * share:.0f} %" for share in shares]
    first, second = (_crop(fit, cell) for fit in morph.fits)
    sheets = [("photographs", sheet([tile([first], morph.first.name), tile([second], morph.second.name)], columns=2))]
    for title, row in rows.items():
        sheets.append((title, _row(photographed(row, size=cell, turn=False), steps)))
    return stacked(sheets)


def morph_film(morph: Morph, *, size: int) -> list[UInt8[np.ndarray, "size size 3"]]:
    """There and back during one turn, so that the film can be looped.

    Args:
        morph: with two animals.
        size: side of the film, pixels.
    """
    there = [morph.look(share) for share in morph.shares]
    return photographed([*there, *there[-2:0:-1]], size=size, turn=True)


def transfer_sheet(transfer: PoseTransfer, animal: RiggedAnimal, *, cell: int) -> Image.Image:
    """Both photographs, the body in its own pose, and from several sides in the other's.

    Args:
        transfer: with two animals.
        animal: of it.
        cell: side of a picture, pixels.
    """
    own, other = (fit.out for fit in transfer.fits)
    looks = [Look(out.posed.verts[0], out.posed.faces).grounded() for out in (own, other, transfer.out)]
    before, model, after = ([body_views(each, views=VIEWS, size=cell)[view] for view in (0, 2)] for each in looks)
    photos = [_crop(fit, cell) for fit in transfer.fits]
    colours = _texture_views(animal, cell)
    tiles = [
        tile([photos[0], *before], f"{transfer.first.name}: its own pose"),
        tile([photos[1], *model], f"{transfer.second.name}: the pose"),
        tile([colours[0], *after], f"{transfer.first.name} in the pose of {transfer.second.name}"),
    ]
    return sheet(tiles, columns=1)


def _texture_views(animal: RiggedAnimal, size: int) -> list[np.ndarray]:
    from fauna.viewer.turntable import turntable_frames

    return turntable_frames(animal, clip=None, size=size, frames=VIEWS, fps=FPS)


def _row(pictures: Sequence[np.ndarray], captions: Sequence[str]) -> Image.Image:
    tiles = [tile([each], caption) for each, caption in zip(pictures, captions, strict=True)]
    return sheet(tiles, columns=len(tiles))


def _crop(fit: Fit, cell: int) -> UInt8[np.ndarray, "cell cell 3"]:
    return np.asarray(Image.fromarray(fit.crop).resize((cell, cell), Image.Resampling.LANCZOS))


def _write_result(
    pair: Pair, facts: Mapping[str, Any], folder: Path, clock: Clock, files: Sequence[str], extra: Mapping[str, object]
) -> None:
    """The first photograph's report under the pair's name and status, with the second's beside it."""
    content = report(pair.first, seconds=clock.seconds, files=[*files, RESULT])
    other = report(pair.second, seconds={}, files=())
    kept = ("name", "status", "reason", "flags", "confidence", "input", "animal")
    own = {"name": pair.name, "status": pair.status, "reason": pair.reason, "flags": list(pair.flags)}
    own |= {"confidence": round(pair.confidence, 4)}
    first = {name: content[name] for name in kept if name not in ("input", "animal")}
    application = {**facts, "first": first, "second": {name: other[name] for name in kept}}
    write_json({**content, **own, "application": application, **extra}, folder / RESULT)
