"""Which planes a detector regresses on."""

import pytest

from clsim.detect.config import DetectorConfig
from clsim.detect.features import feature_names
from clsim.errors import InputError


def test_feature_choice_errors_name_the_plane():
    with pytest.raises(InputError, match=r"'Nz'.*R, G, B"):
        feature_names(DetectorConfig(features=("Nz",)), ("R", "G", "B"))
    with pytest.raises(InputError, match="'Samples'"):
        feature_names(DetectorConfig(features=("Samples",)), ("R", "G", "B", "Samples"))


@pytest.mark.parametrize("weights", [(0.0, 0.0, 0.0), (-0.1, 0.6, 0.5)])
def test_weights_that_leave_no_brightness_are_refused(weights):
    with pytest.raises(InputError, match="`luminance` must be weights that are not negative, and not all 0"):
        DetectorConfig(luminance=weights)
