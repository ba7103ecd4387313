"""Parameter services of a node that accept any request."""

from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import ParameterType, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService

_LARGEST_TYPE = ParameterType.PARAMETER_STRING_ARRAY


class ParameterRequests(ParameterService):
    """
    Parameter services of rclpy that reject a value of an unknown type; those of rclpy itself would raise.

    Parameters
    ----------
    node
        The node.
    """

    def _set_parameters_callback(
        self, request: SetParameters.Request, response: SetParameters.Response
    ) -> SetParameters.Response:
        response.results = [self._set([message]) for message in request.parameters]
        return response

    def _set_parameters_atomically_callback(
        self, request: SetParametersAtomically.Request, response: SetParametersAtomically.Response
    ) -> SetParametersAtomically.Response:
        response.result = self._set(request.parameters)
        return response

    def _set(self, messages: Sequence[Any]) -> SetParametersResult:
        for message in messages:
            kind = message.value.type
            if not 0 < kind <= _LARGEST_TYPE:
                return SetParametersResult(
                    successful=False,
                    reason=f'invalid type of parameter {message.name[:80]}: {kind}; expected 1 to {_LARGEST_TYPE}',
                )
        result: SetParametersResult = self._get_node().set_parameters_atomically(
            [Parameter.from_parameter_msg(message) for message in messages]
        )
        return result
