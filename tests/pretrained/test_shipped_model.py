"""The model in the package, on animals drawn here that it has never seen: the zoo that trained it has another seed."""

import pytest
from hydra import compose, initialize_config_dir

from fauna import FaunaModel
from fauna._conf import CONF_DIR
from fauna.eval import evaluate
from fauna.pretrained import shipped
from fauna.zoo import Zoo

SPECIES = ("cat", "cow", "fox", "zebra")
PHOTOS = 3


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    if not shipped._folder().joinpath(shipped.INDEX).is_file():
        pytest.skip("no model ships with this version")
    animals = [
        f"data.source.species=[{','.join(SPECIES)}]",
        f"data.source.photos_per_species={PHOTOS}",
        "data.split=all",
    ]
    fast = ["size=128", "bootstrap=20", "threads=1", "baselines=[feature_matching]", "pictures=1", "settings=[]"]
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        cfg = compose("eval", overrides=["checkpoint=pretrained", "data=zoo", *animals, *fast])
    return evaluate(cfg, tmp_path_factory.mktemp("shipped"))


def test_none_of_the_animals_was_trained_on(report):
    assert report["protocol"]["dataset"]["training_photos"]["included"] == 0
    assert report["metrics"]["iou"]["n"] == len(SPECIES) * PHOTOS


def test_silhouettes_and_transfer(report):
    found = {name: row["value"] for name, row in report["metrics"].items()}
    assert found["iou"] > 0.78
    assert found["novel_view_iou"] > 0.50
    assert found["kt_pck@0.1"] > 0.60
    assert found["global_flip"] == 0  # the head is at +z


def test_a_photograph_becomes_an_articulated_mesh():
    if not shipped._folder().joinpath(shipped.INDEX).is_file():
        pytest.skip("no model ships with this version")
    drawn = Zoo(seed=0, image_size=256).sample("zebra", 0)
    out = FaunaModel.from_pretrained().reconstruct(drawn.image, drawn.mask)
    silhouette = out.renders.silhouette[0] > 0.5
    assert out.pose is not None
    assert out.posed.verts.shape[1] > 1000
    assert 0.02 < float(silhouette.float().mean()) < 0.8
