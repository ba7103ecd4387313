"""Short parts of the campaigns of full disks and of long runs."""

import subprocess

import pytest

from benchmarks import disk_full, long_run


def test_disks_that_become_full(tmp_path):
    try:
        with disk_full.small_disk(100_000):
            pass
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(str(error))
    result = disk_full.run_campaign(3, seed=1, with_rig=False)
    assert result.wrong == []
    assert result.trials == 3
    assert result.began > 0


def test_a_run_that_is_read_in_pieces_takes_little_memory(tmp_path):
    """Of 2^17 ticks or more; whole arrays of this one would take 300 MB."""
    result = long_run.run_campaign(140_000, 0, tmp_path)
    assert result.wrong == []
    assert set(result.measured) == {'simulate with its summary', 'recover', 'replay'}
    assert result.measured['recover'][0] < 250.0
