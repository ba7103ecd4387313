import numpy as np
import pytest

from hdd_servo_ros.loop.metrics import tracking_metrics


def test_of_a_sine_error():
    t = np.arange(20000) * 1e-4
    x_d = np.sin(t)
    error = 0.005 * np.sqrt(2.0) * np.sin(2.0 * np.pi * 100.0 * t)
    x = x_d + error + 0.002
    u = np.full_like(t, 0.25)
    u[3] = -0.75
    metrics = tracking_metrics(t, x_d, x, u, transient=1.0)
    assert metrics.samples == 10000
    assert metrics.mean_error == pytest.approx(2.0)
    assert metrics.rms_error == pytest.approx(np.hypot(5.0, 2.0))
    # Three standard deviations about the mean, (1.1) and (1.2).
    assert metrics.tmr == pytest.approx(15.0, rel=1e-4)
    assert metrics.max_error == pytest.approx(5.0 * np.sqrt(2.0) + 2.0, rel=1e-3)
    assert metrics.peak_control == 0.75
    assert metrics.rms_control == pytest.approx(0.25)


def test_the_transient_ends_with_its_tick():
    t = np.arange(10) * 1e-4
    x = np.where(np.arange(10) < 5, 1.0, 0.0)
    assert tracking_metrics(t, np.zeros(10), x, x, transient=5e-4).max_error == 0.0
    assert tracking_metrics(t, np.zeros(10), x, x, transient=4e-4).max_error == 1000.0


def test_other_units():
    assert tracking_metrics([0.0], [0.0], [2.0], [0.0], unit=1.0).rms_error == 2.0


def test_what_is_refused():
    with pytest.raises(ValueError, match='transient'):
        tracking_metrics([0.0, 1.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], transient=2.0)
    with pytest.raises(ValueError, match='shape'):
        tracking_metrics([0.0, 1.0], [0.0, 0.0], [0.0], [0.0, 0.0])
