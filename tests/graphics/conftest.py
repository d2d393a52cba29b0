"""Tests of pictures look at them as users do."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def coarse_pictures() -> None:
    """Pictures stay as fine as they are."""
