"""Sessions of pytest with the package's plugin."""

import os
from pathlib import Path

import pytest

KERNELS = os.environ.get('XDG_CACHE_HOME') or str(Path.home() / '.cache')


@pytest.fixture
def run_pytest(pytester, monkeypatch):
    """Run pytest with the plugin on what pytester has made."""
    # pytester gives its sessions another home, and the compiled kernels lie in this one's.
    monkeypatch.setenv('XDG_CACHE_HOME', KERNELS)
    return lambda *arguments: pytester.runpytest_subprocess('-p', 'hdd_servo_ros.testing.plugin', *arguments)
