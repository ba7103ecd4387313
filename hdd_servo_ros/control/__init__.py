"""Controllers: the thesis's adaptive neural network law, the conventional PID, and open loop; no ROS."""

from typing import TYPE_CHECKING

from hdd_servo_ros.lazy import lazily

if TYPE_CHECKING:
    from hdd_servo_ros.control.adaptive_nn import AdaptiveNn
    from hdd_servo_ros.control.adaptive_nn_parameters import AdaptiveNnParameters
    from hdd_servo_ros.control.cnf import (
        CnfParameters,
        cnf_constants,
        cnf_step,
    )
    from hdd_servo_ros.control.controller import Controller
    from hdd_servo_ros.control.observer import Observer, ObserverParameters
    from hdd_servo_ros.control.open_loop import OpenLoop, OpenLoopParameters
    from hdd_servo_ros.control.pid import Pid, PidParameters
    from hdd_servo_ros.control.ptos import (
        PtosParameters,
        ptos_constants,
        ptos_step,
    )
    from hdd_servo_ros.messages.controller_inputs import ControllerInputs

__all__ = [
    'AdaptiveNn',
    'AdaptiveNnParameters',
    'CnfParameters',
    'Controller',
    'ControllerInputs',
    'Observer',
    'ObserverParameters',
    'OpenLoop',
    'OpenLoopParameters',
    'Pid',
    'PidParameters',
    'PtosParameters',
    'cnf_constants',
    'cnf_step',
    'ptos_constants',
    'ptos_step',
]

__getattr__ = lazily(
    __name__,
    {
        'AdaptiveNn': '.adaptive_nn',
        'AdaptiveNnParameters': '.adaptive_nn_parameters',
        'CnfParameters': '.cnf',
        'Controller': '.controller',
        'ControllerInputs': 'hdd_servo_ros.messages.controller_inputs',
        'Observer': '.observer',
        'ObserverParameters': '.observer',
        'OpenLoop': '.open_loop',
        'OpenLoopParameters': '.open_loop',
        'Pid': '.pid',
        'PidParameters': '.pid',
        'PtosParameters': '.ptos',
        'cnf_constants': '.cnf',
        'cnf_step': '.cnf',
        'ptos_constants': '.ptos',
        'ptos_step': '.ptos',
    },
)
