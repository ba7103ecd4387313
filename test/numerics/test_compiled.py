import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core.errors import NumbaError

from hdd_servo_ros.numerics import compiled
from hdd_servo_ros.numerics.kernel_folder import kernel_cache_directory


def test_kernels_are_cached_there_and_not_beside_the_sources():
    from hdd_servo_ros.numerics.elementary import exp

    exp(1.0)
    directory = kernel_cache_directory()
    assert list(directory.glob('hdd_servo_ros.numerics.elementary.exp-*.nbi')), sys.version
    assert not list(Path(compiled.__file__).parent.rglob('*.nbi'))


def test_a_kernel_that_allocates_does_not_compile():
    @compiled.compiled
    def allocating(count):
        return np.zeros(count)[0]

    with pytest.raises(NumbaError, match='Only accept returning of array'):
        allocating(3)
