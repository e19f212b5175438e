"""Acceleration traces: a hand slides a rigid stylus over a specimen (paper, section III-A).

The tip rides on the same height field that the photos show, plus the fine roughness of the
material. The contact is a spring and damper between surface and tool (mass m): the profile's
vertical acceleration passes through (c s + k) / (m s^2 + c s + k), whose resonance tells stiff
from soft. The tool is never pulled down, so in free fall its acceleration is bounded by the hand's
force. Along the stroke, friction follows the normal motion and stick-slip loads and releases the
bending tool in a sawtooth.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate, ndimage, signal, spatial

from tex_lightning.synthetic.specimen import MICRO_PITCH, PITCH, Field, Specimen

GRAVITY = 9.81  # m/s^2
RANGE = 6.0  # g, of the accelerometer named in the paper
MASS = 0.05  # kg, moving with the tip
_HAND_STIFFNESS = 300.0  # N/m, of the grip
_BENDING_HZ, _BENDING_DAMPING = 170.0, 0.12  # tool held in the hand, along the stroke
_BODY_HZ, _BODY_QUALITY, _BODY_GAIN = 430.0, 8.0, 0.5  # ringing of the stylus itself

Signal = NDArray[np.float64]


@dataclass(frozen=True)
class Stroke:
    """Free-hand movement over the surface.

    Attributes:
        position: Place of the tip in mm, shape (2, T), rows x and y.
        speed: Speed in mm/s, shape (T,), zero until the tip has landed.
        force: Normal force in N, shape (T,).
        landing: Index of the sample at which the tool touches the surface.
        sampling_rate: Samples per second.
    """

    position: Signal
    speed: Signal
    force: Signal
    landing: int
    sampling_rate: int

    def at_rate(self, sampling_rate: int) -> "Stroke":
        """Return the same movement in samples of another rate."""
        ratio = sampling_rate / self.sampling_rate
        before = np.arange(len(self.speed))
        after = np.arange(round(len(self.speed) * ratio)) / ratio
        # Without the kinks of a straight interpolation, which accelerations would turn into noise.
        position = interpolate.CubicSpline(before, self.position, axis=1)(after)
        speed = np.interp(after, before, self.speed)
        force = np.interp(after, before, self.force)
        return Stroke(position, speed, force, round(self.landing * ratio), sampling_rate)


def draw_stroke(rng: np.random.Generator, seconds: float, sampling_rate: int) -> Stroke:
    """Draw a free-hand stroke.

    The tool hangs in the air for 0.2 to 0.4 s, lands, and then wanders mainly across the grooves
    (along x) with slowly varying speed, direction and force.

    Args:
        rng: Source of everything that varies from stroke to stroke.
        seconds: Duration of the recording, at least 1.
        sampling_rate: Samples per second.
    """
    count = round(seconds * sampling_rate)
    mean_speed = 90 * float(np.exp(0.12 * np.clip(rng.standard_normal(), -2, 2)))  # mm/s
    mean_force = float(np.exp(0.2 * np.clip(rng.standard_normal(), -2, 2)))  # N
    lead = rng.uniform(0.2, 0.4)
    speed = np.exp(0.15 * drift(rng, count, sampling_rate))
    force = mean_force * np.exp(0.15 * drift(rng, count, sampling_rate))
    heading = np.deg2rad(rng.uniform(-15, 15) + 8 * drift(rng, count, sampling_rate))
    # The hand rests for a moment after the landing and then sets off smoothly.
    since_start = np.arange(count) / sampling_rate - lead - 0.06
    speed *= mean_speed * _smooth_step(since_start / 0.15)
    velocity = speed * np.stack([np.cos(heading), np.sin(heading)])
    origin = rng.uniform(0, 60, (2, 1))
    position = origin + np.cumsum(velocity, axis=1) / sampling_rate
    return Stroke(position, speed, force, round(lead * sampling_rate), sampling_rate)


def slide_tool(
    specimen: Specimen, rng: np.random.Generator, seconds: float, sampling_rate: int
) -> NDArray[np.float32]:
    """Record one stroke over a specimen with a three-axis accelerometer.

    It lasts at least 1 s; all that varies from recording to recording comes from ``rng``.

    Returns:
        Acceleration in g, gravity included, shape (3, seconds * sampling_rate), within
        +-6 g. The axes are those of the tool, whose orientation differs in each recording.
    """
    stroke = draw_stroke(rng, seconds, sampling_rate)
    surface = accelerate(specimen, stroke, rng)
    surface[2] += GRAVITY
    turn = spatial.transform.Rotation.random(rng=rng).as_matrix()
    trace = turn @ surface / GRAVITY
    trace += 0.006 * rng.standard_normal(trace.shape)
    return np.clip(trace, -RANGE, RANGE).astype(np.float32)


def accelerate(specimen: Specimen, stroke: Stroke, rng: np.random.Generator) -> Signal:
    """Work out how the stroke shakes the tool, before the sensor.

    Returns:
        Acceleration in m/s^2, shape (3, T): along the stroke, sideways, and normal to the surface,
        without gravity.
    """
    body = specimen.material.body
    grip = np.exp(0.03 * rng.standard_normal())
    relief = _sample(specimen.contact_height, stroke.position / PITCH)
    profile = relief + _sample(specimen.micro, stroke.position / MICRO_PITCH)
    per_second2 = 1e-3 * stroke.sampling_rate**2  # from mm per sample^2 to m/s^2
    normal = _contact(specimen, stroke, np.gradient(np.gradient(profile)) * per_second2)
    normal = _bound_fall(normal, stroke.force / MASS) + _impact(specimen, stroke, rng)
    along = body.friction * normal + _stick_slip(specimen, stroke, grip, rng)
    sideways = 0.3 * body.friction * normal
    shaken = np.stack([along, sideways, normal])
    shaken += _BODY_GAIN * _ring(shaken, _BODY_HZ * grip, stroke.sampling_rate)
    tremor = [drift(rng, len(profile), stroke.sampling_rate, hertz=9.0) for _ in range(3)]
    return shaken + 0.1 * np.stack(tremor)


def _sample(tile: Field, points: Signal) -> Signal:
    """Read the height of a tile under the tip, in mm, shape (T,)."""
    # Without the prefilter the cubic spline smooths a little more, and stays free of kinks, which
    # the second derivative would turn into noise.
    return ndimage.map_coordinates(
        tile, points[::-1], np.float64, order=3, mode="grid-wrap", prefilter=False
    )


def _contact_frequency(specimen: Specimen, stroke: Stroke) -> float:
    """Give the resonance in rad/s; a Hertzian contact stiffens with the cube root of the force."""
    stiffness = specimen.material.body.stiffness * np.cbrt(stroke.force.mean())
    return float(np.sqrt((stiffness + _HAND_STIFFNESS) / MASS))


def _contact(specimen: Specimen, stroke: Stroke, acceleration: Signal) -> Signal:
    omega = _contact_frequency(specimen, stroke)
    loss = 2 * specimen.material.body.damping * omega
    b, a = signal.bilinear([loss, omega**2], [1, loss, omega**2], stroke.sampling_rate)
    return signal.lfilter(b, a, acceleration)


def _bound_fall(acceleration: Signal, limit: Signal) -> Signal:
    """Bound downward acceleration softly: the surface cannot pull the tool down."""
    return np.where(acceleration < 0, limit * np.tanh(acceleration / limit), acceleration)


def _impact(specimen: Specimen, stroke: Stroke, rng: np.random.Generator) -> Signal:
    """Let the tool bounce once: a decaying oscillation at the contact resonance."""
    omega = _contact_frequency(specimen, stroke)
    damping = specimen.material.body.damping
    since = np.maximum(np.arange(len(stroke.speed)) - stroke.landing, 0) / stroke.sampling_rate
    approach = rng.uniform(0.03, 0.06)  # m/s
    decay = np.exp(-damping * omega * since)
    return approach * omega * decay * np.sin(omega * np.sqrt(1 - damping**2) * since)


def _stick_slip(
    specimen: Specimen, stroke: Stroke, grip: float, rng: np.random.Generator
) -> Signal:
    """Load the tool while the tip sticks and release it at each slip."""
    body = specimen.material.body
    travelled = np.cumsum(stroke.speed) / stroke.sampling_rate / body.stick_length
    # No two slips are the same length or strength.
    starts = np.cumsum(np.exp(0.2 * rng.standard_normal(2 * int(travelled[-1]) + 20))) - 10
    travelled = np.interp(travelled, starts, np.arange(len(starts)))
    slips = np.floor(travelled).astype(int)
    strength = np.exp(0.3 * rng.standard_normal(slips[-1] + 1))[slips]
    # Fast sliding gives the contact no time to stick.
    fading = np.exp(-stroke.speed / 200) * (stroke.speed > 0)
    force = body.stick * stroke.force * strength * fading * (travelled - slips - 0.5)
    omega = 2 * np.pi * _BENDING_HZ * grip
    poles = [1, 2 * _BENDING_DAMPING * omega, omega**2]
    b, a = signal.bilinear([1, 0, 0], poles, stroke.sampling_rate)
    return signal.lfilter(b, a, force / MASS)


def _ring(acceleration: Signal, hertz: float, sampling_rate: int) -> Signal:
    b, a = signal.iirpeak(hertz, _BODY_QUALITY, sampling_rate)
    return signal.lfilter(b, a, acceleration)


def drift(rng: np.random.Generator, count: int, sampling_rate: int, hertz: float = 0.8) -> Signal:
    """Draw a smooth random signal of about unit variance that varies up to ``hertz``."""
    knots = int(2 * hertz * count / sampling_rate) + 4
    values = np.clip(rng.standard_normal(knots), -2, 2)
    at = np.linspace(1.0, knots - 2.0, count)
    return ndimage.map_coordinates(values, at[None], order=3, mode="nearest")


def _smooth_step(position: Signal) -> Signal:
    position = np.clip(position, 0, 1)
    return position * position * (3 - 2 * position)
