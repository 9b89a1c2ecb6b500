"""What a cold command waits for."""

import subprocess
import sys

from tests.runs import command_environment

SLOW = ("lightning", "torchmetrics", "transformers", "matplotlib", "wandb", "torch._dynamo")
PROGRAM = """
import sys, tempfile, numpy, fauna, fauna.reconstruct.batch
rows, columns = numpy.mgrid[:96, :96]
disc = numpy.hypot(rows - 48, columns - 48) < 30
image = numpy.where(disc[..., None], (200, 120, 40), (30, 60, 90)).astype(numpy.uint8)
with tempfile.TemporaryDirectory() as folder:
    fauna.load().reconstruct(image, mask=disc).save(folder)
print([name for name in {slow!r} if name in sys.modules])
"""


def test_nothing_that_takes_seconds_to_import_is_on_the_way_from_a_photograph_to_an_animal():
    command = [sys.executable, "-c", PROGRAM.format(slow=SLOW)]
    done = subprocess.run(command, env=command_environment(), capture_output=True, text=True, timeout=300, check=True)
    assert done.stdout.strip() == "[]"
