"""The tables of the effect of each instrument: completeness, and agreement with separate runs."""

import re

from hdd_servo_ros.analysis.metrics import tracking_metrics
from hdd_servo_ros.simulation.experiment import Experiment
from hdd_servo_ros.studies import instruments

T = 1e-4


def errors(controller, frequency, ldv=None, own=None):
    sections = {
        'reference_generator': {'frequency': frequency},
        'ldv_sensor': ldv or {},
        f'{controller}_controller': own or {},
    }
    rows = Experiment(T, controller, sections).run(0, 22001)
    found = tracking_metrics(rows.time, rows.reference[:, 0], rows.head[:, 0], rows.control[:, 0], 2.0)
    return f'{found.rms_error:.1f} / {found.max_error:.1f}'


def test_the_tables(capsys):
    assert instruments.main(['--seconds', '2.2']) == 0
    rows = {
        name: cells.split(' | ') for name, cells in re.findall(r'^\| (.+?) \| (.+) \|$', capsys.readouterr().out, re.M)
    }
    names = [name for name, _ in (*instruments.LDV_EFFECTS, *instruments.DSP_EFFECTS)]
    assert set(names) <= set(rows)
    assert rows['ADC of 12 bits'][1] == errors('adaptive_nn', 200.0, {'adc_bits': 12})
    late = rows['computation delay of one sample']
    assert late[0] == errors('adaptive_nn', 100.0, own={'dsp.computation_delay': 1})
    assert late[2:] == ['unstable', 'unstable']
    lag = {'velocity_source': 'difference', 'filter_reference': False, 'derivative_bandwidth': 2000.0}
    assert rows['with noise, reference not filtered'][2] == errors('pid', 100.0, own=lag)
