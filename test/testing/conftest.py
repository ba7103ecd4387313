"""Sessions of pytest with the package's plugin."""

import os
from pathlib import Path

import pytest

KERNELS = os.environ.get('XDG_CACHE_HOME') or str(Path.home() / '.cache')


@pytest.fixture
def kernel_cache(pytester, monkeypatch):
    """Let what pytester runs find the compiled kernels: it gives its processes another home."""
    monkeypatch.setenv('XDG_CACHE_HOME', KERNELS)


@pytest.fixture
def run_pytest(pytester, kernel_cache):
    """Run pytest with the plugin on what pytester has made."""
    return lambda *arguments: pytester.runpytest_subprocess('-p', 'hdd_servo_ros.testing.plugin', *arguments)
