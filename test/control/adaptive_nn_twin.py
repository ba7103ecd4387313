"""The adaptive NN law of (4.10)-(4.21) written out slowly, for the tests: 25 Gaussians, no tensor product, libm."""

import itertools
import math

import numpy as np


class Twin:
    """The thesis's law with its options, from an :class:`AdaptiveNnParameters`."""

    def __init__(self, parameters, sample_time):
        self.p, self.T = parameters, sample_time
        network = parameters.network
        self.centres = [
            (x, v)
            for x in np.linspace(network.position_minimum, network.position_maximum, network.nodes)
            for v in np.linspace(network.velocity_minimum, network.velocity_maximum, network.nodes)
        ]
        self.sigma, self.mass, self.phi = parameters.sigma.initial, parameters.mass.initial, parameters.phi.initial
        self.W = np.resize(np.array(network.initial, dtype=float), len(self.centres))
        self.widths = np.zeros(2)
        self.integral = 0.0
        self.saturated = 0
        self.past = [(0.0, 0.0)]

    def activations(self, x, v):
        width_x, width_v = np.array(self.p.network.axis_widths) * np.exp(self.widths)
        return np.array([math.exp(-(((x - a) / width_x) ** 2) - ((v - b) / width_v) ** 2) for a, b in self.centres])

    def law(self, theta, gain, leakage, drive):
        """theta' = gain (drive - leakage theta) over T, by its solution."""
        if leakage == 0.0:
            return theta + gain * self.T * drive
        rest = drive / leakage
        return rest + (theta - rest) * math.exp(-gain * leakage * self.T)

    def bounded(self, value, minimum, maximum):
        return min(max(value, minimum), maximum) if self.p.projection else value

    def step(self, x, v, x_d, dx_d, ddx_d):
        p = self.p
        self.past.append((x_d, dx_d))
        x_d -= p.shaping.share * self.late_jumps()
        e, e_rate = x - x_d, v - dx_d
        if p.integral_gain > 0.0:
            self.integral += self.T * e
        r = e_rate + p.error_filter_lambda * e + p.integral_gain * self.integral
        a_r = ddx_d - p.error_filter_lambda * e_rate - p.integral_gain * e
        sign = np.sign(r) if p.boundary_layer == 0.0 else np.clip(r / p.boundary_layer, -1.0, 1.0)
        z = (x_d, dx_d) if p.network.input == 'reference' else (x, v)
        S = self.activations(*z)
        u = -p.feedback_gain * r
        u += self.sigma * v * p.sigma.enabled
        u += self.mass * a_r * p.mass.enabled
        u -= self.W @ S * sign * p.network.enabled
        u -= self.phi * sign * p.phi.enabled
        limited = min(max(u, -p.control_limit), p.control_limit)
        if limited != u:
            self.saturated += 1
            if p.freeze_when_saturated:
                return limited, u, -p.feedback_gain * r
        if p.r_limit > 0.0:
            r = min(max(r, -p.r_limit), p.r_limit)
        if p.sigma.enabled:
            value = self.law(self.sigma, p.sigma.gain, p.sigma.leakage, -v * r)
            self.sigma = self.bounded(value, p.sigma.minimum, p.sigma.maximum)
        if p.mass.enabled:
            value = self.law(self.mass, p.mass.gain, p.mass.leakage, -a_r * r)
            self.mass = self.bounded(value, p.mass.minimum, p.mass.maximum)
        if p.phi.enabled:
            value = self.law(self.phi, p.phi.gain, p.phi.leakage, abs(r))
            self.phi = self.bounded(value, p.phi.minimum, p.phi.maximum)
        if p.network.enabled:
            weights = self.W.copy()
            gains = np.resize(np.array(p.network.gain), len(weights))
            for i in range(len(weights)):
                value = self.law(weights[i], gains[i], p.network.leakage, S[i] * abs(r))
                self.W[i] = self.bounded(value, -p.network.maximum, p.network.maximum)
            if p.width.enabled:
                slopes = self.width_slopes(weights, S, *z)
                reach = math.log(p.width.factor)
                for axis in range(2):
                    drive = slopes[axis] * abs(r)
                    value = self.law(self.widths[axis], p.width.gain, p.width.leakage, drive)
                    self.widths[axis] = min(max(value, -reach), reach)
        return limited, u, -p.feedback_gain * (e_rate + p.error_filter_lambda * e + p.integral_gain * self.integral)

    def late_jumps(self):
        """The jumps of x_d at rest that are younger than the delay; only for jumps further apart than it."""
        young = self.past[-round(self.p.shaping.delay / self.T) - 1 :]
        return sum(b - a for (a, va), (b, vb) in itertools.pairwise(young) if va == 0.0 == vb)

    def width_slopes(self, weights, S, x, v):
        """d(W'S)/d(ln eta) of both axes, by central differences of (4.7) itself."""
        slopes, step, kept = [], 1e-6, self.widths.copy()
        for axis in range(2):
            values = []
            for sign in (1.0, -1.0):
                self.widths = kept.copy()
                self.widths[axis] += sign * step
                values.append(weights @ self.activations(x, v))
            slopes.append((values[0] - values[1]) / (2.0 * step))
        self.widths = kept
        return slopes
