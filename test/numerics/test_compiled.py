import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core.errors import NumbaError

from hdd_servo_ros.numerics import compiled


def test_the_cache_goes_where_it_can(tmp_path, monkeypatch):
    """A read-only install, or no home, still starts warm the second time."""
    blocked = tmp_path / 'a_file'
    blocked.write_text('')
    monkeypatch.setenv('XDG_CACHE_HOME', str(blocked))
    monkeypatch.setattr(Path, 'home', lambda: tmp_path / 'home')
    assert tmp_path / 'home' in compiled.kernel_cache_directory.__wrapped__().parents
    monkeypatch.setattr(Path, 'home', lambda: blocked)
    monkeypatch.setattr('tempfile.tempdir', str(tmp_path / 'temporary'))
    found = compiled.kernel_cache_directory.__wrapped__()
    assert tmp_path / 'temporary' in found.parents
    assert found.is_dir()


def test_a_change_of_any_kernel_source_takes_another_folder(tmp_path, monkeypatch):
    package = tmp_path / 'hdd_servo_ros'
    shutil.copytree(Path(compiled.__file__).parent.parent, package, ignore=shutil.ignore_patterns('__pycache__'))
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    monkeypatch.setattr(compiled, '__file__', str(package / 'numerics' / 'compiled.py'))
    before = compiled.kernel_cache_directory.__wrapped__()
    (package / 'nodes' / 'rig.py').write_text('')
    assert compiled.kernel_cache_directory.__wrapped__() == before
    for changed in ('drive/friction/parameters.py', 'messages/controller_inputs.py'):
        source = package / changed
        source.write_text(source.read_text() + '\n')
        after = compiled.kernel_cache_directory.__wrapped__()
        assert after != before, changed
        before = after


def test_kernels_are_cached_there_and_not_beside_the_sources():
    from hdd_servo_ros.numerics.elementary import exp

    exp(1.0)
    directory = compiled.kernel_cache_directory()
    assert list(directory.rglob('elementary.exp-*.nbi')), sys.version
    assert not list(Path(compiled.__file__).parent.rglob('*.nbi'))


def test_a_kernel_that_allocates_does_not_compile():
    @compiled.compiled
    def allocating(count):
        return np.zeros(count)[0]

    with pytest.raises(NumbaError, match='Only accept returning of array'):
        allocating(3)
