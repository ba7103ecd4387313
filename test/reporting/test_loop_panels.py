"""Which diagrams over time a run has, and what they show of a disturbance."""

import numpy as np

from hdd_servo_ros.parameters.files import parse_ros_arguments
from hdd_servo_ros.reporting.loop_panels import loop_panels
from hdd_servo_ros.simulation.run_setup import Simulation

ON = ('-p', 'disturbance_generator:vibration.rotational.enabled:=true')


def panels(*arguments):
    parsed = parse_ros_arguments(['--ros-args', '-p', 'controller:=pid', *arguments])
    rows = Simulation(parsed).experiment.run(0, 400)
    return rows, {panel.name: panel for panel in loop_panels(rows, follows=True)}


def test_a_disturbance_is_drawn_with_the_feedforward_that_is_to_cancel_it():
    rows, found = panels(*ON, '-p', 'pid_controller:feedforward.method:=fixed')
    assert list(found) == ['tracking', 'error', 'control', 'disturbance', 'feedforward', 'estimates']
    force, feedforward = found['disturbance'].traces
    assert (force.name, feedforward.name) == ('force against u', 'feedforward')
    np.testing.assert_array_equal(force.y, rows.disturbance.force)
    np.testing.assert_array_equal(feedforward.y, rows.estimates['u_ff'])
    assert found['disturbance'].y_label == 'force [V]'
    without, with_it = found['feedforward'].traces
    np.testing.assert_array_equal(without.y, 1e3 * rows.estimates['ff_rms_without'])
    np.testing.assert_array_equal(with_it.y, 1e3 * rows.estimates['ff_rms'])
    assert not any(trace.name.startswith(('u_ff', 'ff_rms')) for trace in found['estimates'].traces)


def test_without_feedforward_the_force_alone():
    _, found = panels(*ON)
    assert [trace.name for trace in found['disturbance'].traces] == ['force against u']


def test_no_diagram_of_what_does_not_act():
    assert 'disturbance' not in panels()[1]
    assert 'disturbance' not in panels('-p', 'disturbance_generator:shock.enabled:=false')[1]
