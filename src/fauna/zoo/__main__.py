"""``python -m fauna.zoo --out sheet.png [--per-species 6] [--truth]`` writes a contact sheet."""

import argparse

import numpy as np
from PIL import Image, ImageDraw

from fauna.zoo import SPECIES, Zoo, ZooSample


def main() -> None:
    """Parse the command line and write the sheet."""
    parser = argparse.ArgumentParser(description="Contact sheet of the zoo.")
    parser.add_argument("--out", required=True, help="PNG to write")
    parser.add_argument("--per-species", type=int, default=6)
    parser.add_argument("--species", nargs="+", default=list(SPECIES), choices=SPECIES)
    parser.add_argument("--first", type=int, default=0, help="index of the first photo")
    parser.add_argument(
        "--stride", type=int, default=5, help="step between the indices; 5 shows a new individual each time"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--truth", action="store_true", help="draw the mask's outline and the keypoints")
    args = parser.parse_args()
    zoo = Zoo(seed=args.seed, image_size=args.size)
    rows = []
    for species in args.species:
        samples = [zoo.sample(species, args.first + i * args.stride) for i in range(args.per_species)]
        rows.append(np.concatenate([tile(sample, truth=args.truth) for sample in samples], 1))
    Image.fromarray(np.concatenate(rows)).save(args.out)


def tile(sample: ZooSample, *, truth: bool) -> np.ndarray:
    """One labelled crop: left keypoints red, right green, middle yellow; hidden ones hollow."""
    pixels = sample.image.copy()
    size = len(pixels)
    if truth:
        inner = sample.mask > 0
        edge = inner & ~(np.roll(inner, 1, 0) & np.roll(inner, -1, 0) & np.roll(inner, 1, 1) & np.roll(inner, -1, 1))
        pixels[edge] = (255, 0, 255)
    image = Image.fromarray(pixels)
    draw = ImageDraw.Draw(image)
    label = sample.truth.species
    if truth:
        label += f" #{sample.truth.individual} {sample.truth.activity} az {sample.truth.azimuth_deg:.0f} el {sample.truth.elevation_deg:.0f}"
        for name, spot, seen in zip(
            sample.truth.keypoint_names, sample.truth.keypoints_2d, sample.truth.keypoint_visible, strict=True
        ):
            x, y = (spot + 1) * size / 2
            colour = {"left": (255, 60, 60), "righ": (60, 255, 60)}.get(name[:4], (255, 255, 0))
            draw.ellipse((x - 2.5, y - 2.5, x + 2.5, y + 2.5), fill=colour if seen else None, outline=colour)
    draw.text((3, 2), label, fill=(255, 255, 255), stroke_width=1, stroke_fill=(0, 0, 0))
    return np.asarray(image)


if __name__ == "__main__":
    main()
