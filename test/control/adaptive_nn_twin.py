"""Slow reference implementation of the adaptive NN law (4.10)-(4.21): 25 Gaussians, no tensor product, libm."""

import itertools
import math

import numpy as np


class Twin:
    """The thesis's law with its options, for the parameters :class:`AdaptiveNnParameters`."""

    def __init__(self, parameters, sample_time):
        self.p, self.T = parameters, sample_time
        network = parameters.network
        self.centers = [
            (x, v)
            for x in np.linspace(network.position_minimum, network.position_maximum, network.nodes)
            for v in np.linspace(network.velocity_minimum, network.velocity_maximum, network.nodes)
        ]
        self.sigma, self.mass, self.phi = parameters.sigma.initial, parameters.mass.initial, parameters.phi.initial
        self.W = np.resize(np.array(network.initial, dtype=float), len(self.centers))
        self.widths = np.zeros(2)
        self.integral = 0.0
        self.saturated = 0
        self.past = [(0.0, 0.0)]
        bristle = parameters.bristle
        self.bristles = np.array([law.initial for law in (bristle.spring, bristle.hysteresis, bristle.relaxation)])
        self.z = np.zeros(2)
        self.x_d = 0.0
        self.regressors = [np.zeros(5)] * (parameters.desired.ticks(sample_time) + 1)

    def activations(self, x, v):
        width_x, width_v = np.array(self.p.network.axis_widths) * np.exp(self.widths)
        return np.array([math.exp(-(((x - a) / width_x) ** 2) - ((v - b) / width_v) ** 2) for a, b in self.centers])

    def law(self, theta, gain, leakage, drive):
        """Solve theta' = gain (drive - leakage theta) over T."""
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
        velocity, acceleration = v, a_r
        if p.desired.enabled:
            velocity, acceleration = dx_d, ddx_d
            self.regressors.append(self.regressors_of(x_d, dx_d, ddx_d))
            u += self.bristles @ self.regressors[-1][2:] * p.bristle.enabled
        u += self.sigma * velocity * p.sigma.enabled
        u += self.mass * acceleration * p.mass.enabled
        u -= self.W @ S * sign * p.network.enabled
        u -= self.phi * sign * p.phi.enabled
        limited = min(max(u, -p.control_limit), p.control_limit)
        if limited != u:
            self.saturated += 1
            if p.freeze_when_saturated:
                return limited, u, -p.feedback_gain * r
        if p.r_limit > 0.0:
            r = min(max(r, -p.r_limit), p.r_limit)
        drives = np.array([-v * r, -a_r * r, 0.0, 0.0, 0.0])
        rests = p.desired.enabled and dx_d == 0.0 == ddx_d
        if p.desired.enabled:
            late = self.regressors[-1 - p.desired.ticks(self.T)]
            drives = -late * r / (1.0 + self.excitation())
        if p.sigma.enabled and not rests:
            value = self.law(self.sigma, p.sigma.gain, p.sigma.leakage, drives[0])
            self.sigma = self.bounded(value, p.sigma.minimum, p.sigma.maximum)
        if p.mass.enabled and not rests:
            value = self.law(self.mass, p.mass.gain, p.mass.leakage, drives[1])
            self.mass = self.bounded(value, p.mass.minimum, p.mass.maximum)
        if p.bristle.enabled and not rests:
            for i, law in enumerate((p.bristle.spring, p.bristle.hysteresis, p.bristle.relaxation)):
                value = self.law(self.bristles[i], law.gain, law.leakage, drives[2 + i])
                self.bristles[i] = self.bounded(value, law.minimum, law.maximum)
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

    def regressors_of(self, x_d, dx_d, ddx_d):
        """x_d', x_d'', z_2, z_1 - z_2 and -|x_d'| z_1/d_1; a step of the reference does not move the bristles."""
        moves = dx_d != 0.0 or self.past[-2][1] != 0.0
        d = np.array([self.p.bristle.distance, self.p.bristle.spring_distance])
        if moves:
            # dz/dx = 1 - z sgn(x')/d over the sample, in small steps of the trapezoidal rule.
            change = (x_d - self.x_d) / 200.0
            for _ in range(200):
                half = 0.5 * abs(change) / d
                self.z = (self.z * (1.0 - half) + change) / (1.0 + half)
        self.x_d = x_d
        return np.array([dx_d, ddx_d, self.z[1], self.z[0] - self.z[1], -abs(dx_d) * self.z[0] / d[0]])

    def excitation(self):
        """Return (peak/scale)^2 of each regressor, with the held, decaying peak of its square; 0 without a scale."""
        p, count = self.p, len(self.regressors)
        decay = np.exp(-p.desired.peak_decay * self.T * np.arange(count - 1, -1, -1))
        peaks = (np.array(self.regressors) ** 2 * decay[:, None]).max(axis=0)
        laws = (p.sigma, p.mass, p.bristle.spring, p.bristle.hysteresis, p.bristle.relaxation)
        return np.array([peak / law.scale**2 if law.scale else 0.0 for peak, law in zip(peaks, laws, strict=True)])

    def late_jumps(self):
        """Return the sum of steps of x_d within the delay; only for steps further apart than the delay."""
        young = self.past[-round(self.p.shaping.delay / self.T) - 1 :]
        return sum(b - a for (a, va), (b, vb) in itertools.pairwise(young) if va == 0.0 == vb)

    def width_slopes(self, weights, S, x, v):
        """Return d(W'S)/d(ln eta) of both axes, by central differences of (4.7)."""
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
