"""A pile of photographs to prepare: pictures of the zoo with their masks beside them, ``<species>/<number>.png`` and ``_mask.png``.

python tests/prepare/zoo_pile.py FOLDER COUNT [SIZE]
"""

import sys
from pathlib import Path

from PIL import Image

from fauna.zoo import SPECIES, Zoo


def draw_pile(folder: Path, count: int, size: int, seed: int = 0) -> None:
    """Draw what is missing.

    Args:
        folder: of the pile.
        count: of pictures, species taking turns.
        size: side of a picture, pixels.
        seed: of the zoo.
    """
    zoo = Zoo(seed=seed, image_size=size)
    names = sorted(SPECIES)
    for number in range(count):
        species, index = names[number % len(names)], number // len(names)
        picture = folder / species / f"{index:05d}.png"
        if not picture.exists():
            sample = zoo.sample(species, index)
            picture.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(sample.mask).save(picture.with_name(f"{picture.stem}_mask.png"))
            Image.fromarray(sample.image).save(picture)


if __name__ == "__main__":
    draw_pile(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 64)
