"""Short parts of the campaigns of full disks and of long runs."""

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import disk_full

ROOT = Path(__file__).parents[2]


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
    # Of a process of its own: the memory of its commands counts from what it takes itself.
    command = [sys.executable, '-m', 'benchmarks.long_run', '140000', '0', '--folder', str(tmp_path)]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=500.0)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    for name in ('simulate with its summary', 'recover', 'replay'):
        assert name in ran.stdout
