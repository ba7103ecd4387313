"""What the adaptive NN controller's user should be told before a run, where the drive is known."""

import math

from hdd_servo_ros.analysis.sensitivity import MAX_SENSITIVITY, LinearController, LoopMargins
from hdd_servo_ros.control.adaptive_nn import AdaptiveNn
from hdd_servo_ros.drive.plant import PlantParameters


def peak_sensitivity(controller: AdaptiveNn, plant: PlantParameters, delay: int = 0) -> float:
    """
    Return Ms of the linear gain that the law comes to on r, in presliding or sliding, whichever is larger.

    What sigma_hat and m_hat learn is left out, and so is the filter of a difference of displacements.

    Parameters
    ----------
    controller
        Its gain on r, lambda, lambda_i and T count.
    plant
        The drive.
    delay
        Samples by which u comes late.

    Returns
    -------
    float
        Infinity if the loop is unstable.
    """
    g, parameters = controller.gain_on_r, controller.parameters
    if not math.isfinite(g):
        return math.inf
    law = LinearController.on_r(g, parameters.error_filter_lambda, parameters.integral_gain, delay)
    return LoopMargins(plant, controller.sample_time).peak_sensitivity(law)


def warnings(controller: AdaptiveNn, plant: PlantParameters, delay: int = 0) -> tuple[str, ...]:
    """
    Return :meth:`AdaptiveNn.warnings`, with the gain on r judged by this drive and T instead of by ``safe_gain``.

    Parameters are those of :func:`peak_sensitivity`.
    """
    ms = peak_sensitivity(controller, plant, delay)
    if ms <= MAX_SENSITIVITY:
        return controller.sign_warnings()
    loop = 'is unstable' if math.isinf(ms) else f'has a peak sensitivity of {ms:.3g}, above {MAX_SENSITIVITY:g}'
    fragile = (
        f"fragile constants: k + 1/sigma_phi + max(S'S)/sigma_w = {controller.gain_on_r:.3g} V s/um acts as one linear "
        f'gain on r, with which the loop around this drive, at T = {controller.sample_time:g} s, {loop}; it may track '
        'at first and burst after seconds: raise phi.leakage or network.leakage, lower feedback_gain or '
        'error_filter_lambda, or tune it (ros2 run hdd_servo_ros tune)'
    )
    return fragile, *controller.sign_warnings()
