"""A chair in front of a photograph, as several tests take it apart."""

from __future__ import annotations

import pytest

from nablahog.pose.crop import ObjectCrop, crop_object
from nablahog.pose.photograph import PreparedPhotograph

from .common import model, photographed


@pytest.fixture(scope="package")
def crop() -> ObjectCrop:
    return crop_object(*photographed(model(), 40, 15, behind="coffee"))


@pytest.fixture(scope="package")
def photograph(crop: ObjectCrop) -> PreparedPhotograph:
    return PreparedPhotograph(crop)
