"""The files of one animal. ``result.json`` comes last: where it is, everything else is."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from fauna.errors import FaunaError
from fauna.io.contact_sheet import save_png
from fauna.io.run_folder import write_json
from fauna.reconstruct.clock import Clock
from fauna.reconstruct.report import report
from fauna.reconstruct.result import Fit, Result
from fauna.reconstruct.settings import OutputSettings

if TYPE_CHECKING:
    from fauna.export import RiggedAnimal
    from fauna.texture import Texture

RESULT, PREVIEW, VIEWER, BANK = "result.json", "preview.png", "viewer.html", "bank.png"
MODEL = "model"
"""Stem of the model's files."""
WALK = "walk"
"""The clip of turntables."""


def texture(result: Result) -> "Texture | None":
    """See :attr:`fauna.reconstruct.result.Result.texture`."""
    fit, output = _fit(result), result.settings.output
    if not output.texture_size:
        return None
    from fauna.texture import bake

    return bake(fit.model, fit.out, size=output.texture_size, source=output.texture_source, batch=fit.batch)


def rig(result: Result) -> "RiggedAnimal":
    """See :meth:`fauna.reconstruct.result.Result.rigged`."""
    from fauna.export import rig_reconstruction

    fit = _fit(result)
    return rig_reconstruction(fit.model, fit.out, name=result.name, texture=result.texture)


def write(result: Result, folder: Path, **extra: object) -> None:
    """Write everything the settings ask for into an existing folder.

    Args:
        result: also one without an animal; then ``result.json`` alone is written.
        folder: where to.
        extra: further keys of ``result.json``.
    """
    clock = Clock()
    clock.seconds = dict(result.seconds)
    files: list[str] = []
    if result.fit is not None:
        files = _models(result, folder, clock)
        with clock.stage("preview"):
            from fauna.reconstruct.preview import preview

            save_png(preview(result, cell=result.settings.output.preview_cell), folder / PREVIEW)
        files.append(PREVIEW)
        if result.settings.bank.view and result.fit.bank is not None:
            with clock.stage("bank"):
                save_png(bank_picture(result), folder / BANK)
            files.append(BANK)
    content = report(result, seconds=clock.seconds, files=[*files, RESULT])
    write_json({**content, **extra}, folder / RESULT)


def _models(result: Result, folder: Path, clock: Clock) -> list[str]:
    """Model, viewer and turntable; the names of the files."""
    with clock.stage("texture"):
        _ = result.texture
    with clock.stage("rig"):
        animal = result.rigged()
    output, said, poster = result.settings.output, facts(result), _poster(_fit(result))
    return write_models(animal, output, folder, clock, title=result.name, facts=said, poster=poster, clip=WALK)


def write_models(
    animal: "RiggedAnimal",
    output: OutputSettings,
    folder: Path,
    clock: Clock,
    *,
    title: str,
    facts: Mapping[str, str],
    poster: bytes | None,
    clip: str | None,
) -> list[str]:
    """Write an animal in every form that is asked for.

    Args:
        animal: rigged.
        output: which forms.
        folder: where to.
        clock: told how long each takes.
        title: of the viewer's page.
        facts: on that page.
        poster: picture on that page, JPEG.
        clip: that plays in the turntable, ``None`` for the photo's pose.

    Returns:
        The names of the files.
    """
    from fauna.export import glb_bytes, write_glb, write_obj, write_ply

    writers = {"glb": write_glb, "obj": write_obj, "ply": write_ply}
    for kind in output.formats:
        with clock.stage("export"):
            writers[kind](animal, folder / f"{MODEL}.{kind}")
    files = sorted(each.name for each in folder.iterdir() if each.stem == MODEL or each.name.startswith(f"{MODEL}."))
    if output.viewer:
        from fauna.viewer import write_viewer

        with clock.stage("viewer"):
            write_viewer(glb_bytes(animal), folder / VIEWER, title=title, facts=facts, poster=poster)
        files.append(VIEWER)
    if output.turntable:
        from fauna.viewer import write_turntable

        with clock.stage("turntable"):
            files.append(write_turntable(animal, folder, clip=clip).name)
    return files


def bank_picture(result: Result) -> Image.Image:
    """See :meth:`fauna.reconstruct.result.Result.bank_picture`."""
    from fauna.plots.bank_view import draw_view

    fit, settings = _fit(result), result.settings.bank
    if fit.bank is None:
        raise FaunaError(f"{result.name}: expected a bank with slots, got none; use weights with bank=semantic")
    return draw_view(fit.model, fit.bank, fit.out.code, fit.crop, slots=settings.slots, cell=settings.cell)


def facts(result: Result) -> Mapping[str, str]:
    """What the viewer's page says about the animal."""
    fit = _fit(result)
    said = {
        "photograph": result.source.file or "from memory",
        "status": result.status.replace("_", " "),
        "confidence": f"{result.confidence:.2f}",
        "outline IoU": f"{fit.measures.iou:.2f}",
        "vertices": str(fit.out.posed.verts.shape[1]),
    }
    if result.flags:
        said["notes"] = ", ".join(flag.replace("_", " ") for flag in result.flags)
    return said


def _poster(fit: Fit) -> bytes:
    """The crop as JPEG."""
    buffer = io.BytesIO()
    Image.fromarray(fit.crop).save(buffer, "JPEG", quality=90)
    return buffer.getvalue()


def _fit(result: Result) -> Fit:
    if result.fit is None:
        raise FaunaError(
            f"{result.name}: expected a reconstructed animal, got none ({result.status}: {result.reason}); use another photograph"
        )
    return result.fit
