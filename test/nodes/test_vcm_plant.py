"""Diagnoses of the crash stops by the drive node."""

from types import SimpleNamespace

from hdd_servo_ros.drive.plant import Plant, PlantParameters
from hdd_servo_ros.nodes.vcm_plant import VcmPlant
from hdd_servo_ros.parameters import from_mapping
from hdd_servo_ros.ros.diagnosis import OK, WARN


def node(**stops):
    parameters = from_mapping(PlantParameters, {f'travel.{name}': value for name, value in stops.items()})
    plant = Plant(parameters, 1e-4)
    return SimpleNamespace(_plant=plant, _is_limited=parameters.travel.is_limited, _diagnosed={})


def test_impacts_are_reported_once_and_counted():
    found = node(upper=5.0, lower=-5.0)
    (off,) = VcmPlant.diagnose(found)
    assert (off.level, off.message, off.values) == (OK, 'no new impacts', {})
    for tick in range(1, 100):
        found._plant.step(tick, 0.5)
    count, speed = found._plant.impacts['upper'].count, found._plant.impacts['upper'].largest_speed
    assert count > 1
    values = {'upper stop: impacts in total': count, 'upper stop: largest speed [um/s]': speed}
    (hit,) = VcmPlant.diagnose(found)
    assert (hit.what, hit.level, hit.message, hit.values) == ('travel', WARN, f'hit: upper stop {count} times', values)
    # It rests on the stop now: no new impact.
    (rest,) = VcmPlant.diagnose(found)
    assert (rest.level, rest.message, rest.values) == (OK, 'no new impacts', values)


def test_a_drive_without_stops_has_no_diagnosis_of_them():
    assert list(VcmPlant.diagnose(node())) == []
