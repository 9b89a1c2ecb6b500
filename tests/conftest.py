import os
from pathlib import Path

import pytest

from fauna.threads import set_threads

set_threads(1)


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory):
    """Tests never touch the user's cache."""
    before = os.environ.get("FAUNA_CACHE")
    os.environ["FAUNA_CACHE"] = str(tmp_path_factory.mktemp("cache"))
    yield
    if before is None:
        del os.environ["FAUNA_CACHE"]
    else:
        os.environ["FAUNA_CACHE"] = before


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real photographs beside the checkout, when they are there."""
    root = Path(__file__).parents[2] / "shared" / "data"
    if not root.is_dir():
        pytest.skip("needs the real photographs, which are not part of the project")
    return root
