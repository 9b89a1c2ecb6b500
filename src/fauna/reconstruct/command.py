"""``fauna-reconstruct``: photographs in, rigged and textured animals out. Heavy imports happen once there is work to do."""

import argparse
import contextlib
import os
import signal
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import NoReturn

from fauna.cli import EXIT_INTERRUPTED, one_line_errors
from fauna.errors import FaunaError
from fauna.reconstruct.settings import MOST_FRAMES, Settings, check_range, default_settings

COMMAND = "fauna-reconstruct"
EXIT_NOT_ALL_OK, EXIT_TERMINATED = 1, 143
EPILOG = """exit codes: 0 every photograph is ok; 1 some are not, result.json says why; 2 bad arguments; 130, 143 interrupted.
Run the same command again to go on: finished photographs are skipped. Details: docs/reconstruct.md"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        print(f"fauna: error: {message}; see {COMMAND} --help", file=sys.stderr)
        sys.exit(2)


def main() -> None:
    """Entry point of the command line."""
    given = parse(sys.argv[1:])
    signal.signal(signal.SIGTERM, _terminate)
    try:
        with one_line_errors(COMMAND):
            settings = chosen_settings(given)
            code = _run(given, settings)
            sys.stdout.flush()
    except KeyboardInterrupt:
        print("fauna: interrupted; the same command goes on where it was", file=sys.stderr)
        sys.exit(EXIT_INTERRUPTED)
    except BrokenPipeError:  # nobody reads any more
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(141)
    sys.exit(code)


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The command line; ends the program on a bad one, and after ``--help``."""
    default = default_settings()
    output = default.output
    parser = _Parser(
        prog=COMMAND,
        description="Turn photographs of four-legged animals into rigged, textured, animated 3D models.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("photos", nargs="+", metavar="PHOTO", help="files, folders or patterns")
    add("-o", "--out", default="out", type=Path, metavar="DIR", help="every animal gets DIR/<name>/ (default: out)")
    add(
        "--mask",
        action="append",
        type=Path,
        metavar="FILE",
        help="mask of the one photograph; again for further animals (default: alpha channel, x_mask.png, masks/x*.png, --segmenter)",
    )
    add(
        "--segmenter",
        default=default.mask.segmenter,
        metavar="NAME",
        help="for photographs without a mask: grabcut, sam[:MODEL], rembg[:MODEL] (default: %(default)s)",
    )
    add("--crop-rule", default=default.crop.rule, choices=("widen", "fauna"), help="default: %(default)s")
    add("--format", default=",".join(output.formats), metavar="LIST", help="of glb,obj,ply (default: %(default)s)")
    add(
        "--resolution",
        type=int,
        metavar="N",
        help="of the lattice the mesh is cut from, 8 to 256 (default: that of the training)",
    )
    add("--no-texture", action="store_true", help="leave the texture out")
    add("--texture-size", type=int, default=output.texture_size, metavar="N", help="pixels (default: %(default)s)")
    add(
        "--texture",
        default=output.texture_source,
        choices=("photo", "network"),
        help="what it shows (default: %(default)s)",
    )
    add(
        "--no-finetune",
        action="store_true",
        help=f"skip the {output.finetune_iterations} steps that fit the texture to the photograph",
    )
    add(
        "--refine",
        type=int,
        default=output.refine_steps,
        metavar="N",
        help="steps that fit bone angles and camera to the mask (default: %(default)s)",
    )
    add(
        "--bank",
        action="store_true",
        help="draw bank.png: slots, species and training pictures that the animal resembles",
    )
    add(
        "--morph",
        type=int,
        metavar="N",
        help="from the animal of the first of two photographs to that of the second, in N steps",
    )
    add("--pose-from", type=Path, metavar="FILE", help="show the animals of the photographs in the pose of this one")
    add("--no-viewer", action="store_true", help="leave viewer.html out")
    add("--no-turntable", action="store_true", help="leave the turntable out")
    add("--checkpoint", metavar="FILE", help="weights, checkpoint or run folder (default: the model in the package)")
    add("--device", default="cpu", help="where torch computes (default: %(default)s)")
    add("--threads", type=int, default=1, metavar="N", help="CPU threads (default: %(default)s)")
    add("--overwrite", action="store_true", help="replace results that were made with other options")
    return parser.parse_intermixed_args(arguments)  # fmt: skip


def chosen_settings(given: argparse.Namespace) -> Settings:
    """The settings that a command line asks for.

    Raises:
        FaunaError: for a value outside of its range.
    """
    default = default_settings()
    texture = 0 if given.no_texture else given.texture_size
    return replace(
        default,
        mask=replace(default.mask, segmenter=given.segmenter),
        crop=replace(default.crop, rule=given.crop_rule),
        output=replace(
            default.output,
            formats=tuple(dict.fromkeys(name.strip().lower() for name in given.format.split(","))),
            resolution=given.resolution,
            texture_size=texture,
            texture_source=given.texture,
            finetune_iterations=0 if given.no_finetune else default.output.finetune_iterations,
            refine_steps=given.refine,
            viewer=not given.no_viewer,
            turntable=not given.no_turntable,
        ),
        bank=replace(default.bank, view=given.bank),
    )


def _run(given: argparse.Namespace, settings: Settings) -> int:
    from fauna.reconstruct.folders import find_photos, name_jobs

    photos = find_photos(given.photos)
    _check(given, settings, len(photos))
    from fauna.reconstruct.batch import run_jobs
    from fauna.reconstruct.pairs import morph_job, pose_jobs, run_pairs

    out, masks = given.out.expanduser(), [mask.expanduser() for mask in given.mask or ()]
    common = {
        "checkpoint": given.checkpoint,
        "device": given.device,
        "overwrite": given.overwrite,
        "threads": given.threads,
    }
    if given.morph is not None:
        told = run_pairs([morph_job(photos[0], photos[1], masks, given.morph)], out, settings, **common)
    elif given.pose_from is not None:
        told = run_pairs(pose_jobs(photos, given.pose_from.expanduser(), masks), out, settings, **common)
    else:
        told = run_jobs(name_jobs(photos), out, settings, masks=masks or None, **common)
    return 0 if all(status == "ok" for status in told) else EXIT_NOT_ALL_OK


def _check(given: argparse.Namespace, settings: Settings, photos: int) -> None:
    """Options that do not go together, or name nothing.

    Raises:
        FaunaError: for the first of them.
    """
    if given.morph is not None:
        _check_morph(given, settings, photos)
    elif given.mask and photos > 1:
        raise FaunaError(f"--mask: expected one photograph, got {photos}; put masks beside them as x_mask.png")
    elif given.mask and len(given.mask) > 1 and given.pose_from is not None:
        raise FaunaError(
            f"--mask: expected one with --pose-from, that of the photograph, got {len(given.mask)}; put the other's beside it"
        )
    for mask in given.mask or ():
        if not mask.expanduser().is_file():
            raise FaunaError(f"--mask: expected a picture file, got {mask}, which does not exist; check the path")
    if given.pose_from is not None and not given.pose_from.expanduser().is_file():
        raise FaunaError(
            f"--pose-from: expected a photograph, got {given.pose_from}, which does not exist; check the path"
        )
    if given.out.exists() and not given.out.is_dir():
        raise FaunaError(f"--out: expected a folder, got {given.out}, which is a file; choose another")
    if given.threads < 1:
        raise FaunaError(f"--threads: expected a number >= 1, got {given.threads}; e.g. 2")


def _check_morph(given: argparse.Namespace, settings: Settings, photos: int) -> None:
    check_range("morph", given.morph, 2, MOST_FRAMES)
    if given.pose_from is not None:
        raise FaunaError("--morph: expected one application, got --pose-from as well; leave one out")
    if photos != 2:
        raise FaunaError(f"--morph: expected two photographs, got {photos}; name the first and the last")
    if given.mask and len(given.mask) != 2:
        raise FaunaError(f"--mask: expected two with --morph, one for each photograph, got {len(given.mask)}; add one")
    if settings.output.formats != ("glb",):
        raise FaunaError(f"--format: expected glb with --morph, got {given.format}; leave it out")


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    sys.exit(EXIT_TERMINATED)


if __name__ == "__main__":
    main()
