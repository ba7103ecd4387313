"""The parameter services of a node, whatever a request holds."""

from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import ParameterType, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService

_LARGEST_TYPE = ParameterType.PARAMETER_STRING_ARRAY


class ParameterRequests(ParameterService):
    """
    rclpy's parameter services, which reject a value of a type that there is not, where rclpy's own raise.

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
                    reason=f'parameter {message.name[:80]} is rejected: type {kind}; 1 to {_LARGEST_TYPE} hold a value',
                )
        result: SetParametersResult = self._get_node().set_parameters_atomically(
            [Parameter.from_parameter_msg(message) for message in messages]
        )
        return result
