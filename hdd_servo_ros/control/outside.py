"""Adapter for custom controllers: checks the results of a user's class and names its faults."""

import traceback
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdd_servo_ros.control.controller import HasPlan, KnowsOutputLimit, ReportsFault, WarnsBeforeRun
from hdd_servo_ros.messages.controller_inputs import ControllerInputs
from hdd_servo_ros.messages.exit_codes import WRONG_ARGUMENTS
from hdd_servo_ros.parameters import ParameterError

TIME = 't'
_RAISED = (Exception, SystemExit)
"""Exceptions caught from the class; with SystemExit, ``sys.exit()`` in it ends its run, not the process."""
_OPTIONAL_METHODS = {
    'limit_output': 'a method limit_output(limit)',
    'warnings': 'a method warnings() that returns a list or tuple of strings',
    'fault': 'a method fault() that returns a string',
}


class ControllerError(Exception):
    """Failure of a custom controller at a tick: names the controller, the tick, the reason and the line of its file."""

    exit_code = WRONG_ARGUMENTS

    def __init__(self, controller: str, tick: int, reason: str) -> None:
        super().__init__(f'{controller}: {reason} at tick {tick}')
        self.tick = tick


class OutsideController:
    """
    Adapter from a user's class to the protocol :class:`~hdd_servo_ros.control.controller.Controller`.

    The class is constructed with its parameters and T [s]. It has ``update(parameters)`` and ``step(inputs)``, which
    returns u [V] or the three voltages of the protocol. It may name further signals in ``estimate_names`` and keep
    them in ``estimates``; the adapter prepends the time of the tick if it is missing. It may satisfy
    :class:`~hdd_servo_ros.control.controller.KnowsOutputLimit`,
    :class:`~hdd_servo_ros.control.controller.WarnsBeforeRun`,
    :class:`~hdd_servo_ros.control.controller.ReportsFault` and
    :class:`~hdd_servo_ros.control.controller.HasPlan`; the adapter satisfies exactly the same ones.

    Parameters
    ----------
    name
        Name of the controller in messages.
    kind
        The user's class.
    parameters
        Its parameters.
    sample_time
        T [s].

    Raises
    ------
    ParameterError
        If the class cannot be constructed, its ``estimate_names`` are not strings, its ``last_tick`` is not a tick, or
        an optional method is not callable.
    """

    def __init__(self, name: str, kind: type[Any], parameters: Any, sample_time: float) -> None:
        self._name = name
        self._sample_time = sample_time
        self._tick = 0
        try:
            self._block = kind(parameters, sample_time)
        except ParameterError:
            raise
        except _RAISED as error:
            raise ParameterError(
                'controller', name, f'a class that can be constructed, but it raised {described(error)}'
            ) from error
        for attribute, wanted in _OPTIONAL_METHODS.items():
            found = getattr(self._block, attribute, None)
            if found is not None and not callable(found):
                raise ParameterError('controller', name, f'a class whose {attribute} is {wanted}, not {found!r}')
        # Attributes of the instance, not of its class: only if the user's class has them.
        if isinstance(self._block, KnowsOutputLimit):
            self.limit_output = self._limit_output
        if isinstance(self._block, WarnsBeforeRun):
            self.warnings = self._warnings
        if isinstance(self._block, ReportsFault):
            self.fault = self._fault
        if isinstance(self._block, HasPlan):
            self.last_tick = self._planned_last_tick()
        names = getattr(self._block, 'estimate_names', ())
        if isinstance(names, str) or not all(isinstance(element, str) for element in names):
            raise ParameterError(
                'controller', name, f'a class whose estimate_names are a tuple of strings, not {names!r}'
            )
        self._first_own = 0 if tuple(names[:1]) == (TIME,) else 1
        self._has_estimates = bool(names)
        self.estimate_names: tuple[str, ...] = (TIME,) * self._first_own + tuple(names)
        self.estimates: NDArray[np.float64] = np.zeros(len(self.estimate_names))

    def _limit_output(self, limit: float) -> None:
        try:
            self._block.limit_output(limit)
        except _RAISED as error:
            raise ControllerError(self._name, self._tick, f'limit_output raised {described(error)}') from error

    def _warnings(self) -> tuple[str, ...]:
        try:
            lines = self._block.warnings()
            # A string is iterable too, character by character.
            found = tuple(lines) if isinstance(lines, Iterable) and not isinstance(lines, str) else (None,)
        except _RAISED as error:
            raise ControllerError(self._name, self._tick, f'warnings raised {described(error)}') from error
        if not all(isinstance(line, str) for line in found):
            reason = f'warnings returned {lines!r}, not a list or tuple of strings,'
            raise ControllerError(self._name, self._tick, reason)
        return found

    def _fault(self) -> str:
        # The run has already failed. An error here must not hide that, so it becomes the reason.
        try:
            reason = self._block.fault()
        except _RAISED as error:
            return str(ControllerError(self._name, self._tick, f'fault raised {described(error)}'))
        if not isinstance(reason, str):
            return str(ControllerError(self._name, self._tick, f'fault returned {reason!r}, not a string,'))
        return ' '.join(reason.split())

    def _planned_last_tick(self) -> int:
        try:
            tick = self._block.last_tick
        except _RAISED as error:
            raise ParameterError(
                'controller', self._name, f'a class whose last_tick can be read; it raised {described(error)}'
            ) from error
        if not isinstance(tick, int | np.integer) or isinstance(tick, bool) or tick < 0:
            reason = f'a class whose last_tick is an integer at least 0, not {tick!r}'
            raise ParameterError('controller', self._name, reason)
        return int(tick)

    def update(self, parameters: Any) -> None:
        """Use new parameters from the next tick on; raises :class:`ControllerError` if the class fails to."""
        try:
            self._block.update(parameters)
        except _RAISED as error:
            raise ControllerError(self._name, self._tick, f'update raised {described(error)}') from error

    def step(self, inputs: ControllerInputs) -> tuple[float, float, float]:
        """
        Return u, u before the limit, and its feedback part [V]; a single number from the class is used for all three.

        Raises
        ------
        ControllerError
            If the class raises an exception, or returns or estimates anything but numbers.
        """
        tick = self._tick = inputs.tick
        try:
            answer = self._block.step(inputs)
        except _RAISED as error:
            raise ControllerError(self._name, tick, f'step raised {described(error)}') from error
        if self._has_estimates:
            self._read_estimates(tick)
        self.estimates[0] = tick * self._sample_time  # subscribers to /estimates identify the tick by it
        if type(answer) is float:
            return answer, answer, answer
        numbers = answer if isinstance(answer, tuple) else (answer,) * 3
        if len(numbers) != 3 or not all(_is_number(number) for number in numbers):
            wanted = 'the voltage u, or a tuple of u, u before the limit and its feedback part [V]'
            raise ControllerError(self._name, tick, f'step returned {answer!r}, not {wanted},')
        return float(numbers[0]), float(numbers[1]), float(numbers[2])

    def _read_estimates(self, tick: int) -> None:
        estimates = getattr(self._block, 'estimates', None)
        own = self.estimates[self._first_own :]
        try:
            values = np.asarray(estimates, dtype=np.float64)
        except (TypeError, ValueError):
            values = np.empty(0)
        if values.shape != own.shape:
            names = ', '.join(self.estimate_names[self._first_own :])
            raise ControllerError(self._name, tick, f'estimates = {estimates!r} are not the {len(own)} numbers {names}')
        own[:] = values


def _is_number(value: object) -> bool:
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def described(error: BaseException) -> str:
    """Return an exception in one line: type, message, and the file and line where it was raised."""
    text = ' '.join(str(error).split())
    frames = traceback.extract_tb(error.__traceback__)
    location = f' ({frames[-1].filename}:{frames[-1].lineno})' if frames else ''
    return f'{type(error).__name__}{": " if text else ""}{text}{location}'
