"""How a hand shakes a camera: random rotations with the spectrum of human tremor.

The spectrum. A limb is a mass on a spring with little damping, kept in motion by the irregular force of its muscles; muscle is a
low-pass filter to its own excitation (Elble, "Physiologic and enhanced physiologic tremor", in Movement Disorders, 2003, sec. 22.1;
Lakie et al., J. Physiol. 593, 2015: the hand's peak at 6-12 Hz is almost completely this mechanical resonance; Wade, Gresty and
Findley, Arch. Neurol. 39, 1982: 97 persons, several peaks in two thirds of them). A hand-held camera shows besides the hand's peak
a slower one of the arm, "about 4.0 Hz" with accelerometers on cameras (Jpn. J. Ergonomics 31(6), 1995, 399-). A model of camera
shake made of the same medical observations is that of Gavant et al. (A physiological camera shake model for image stabilization
systems, IEEE Sensors 2011). So the power spectral density of the angular rate is

    S(f) = [ drift / (1 + (f / f_d)^2) + sum_j level_j R(f; f_j, Q_j) ] / (1 + (f / f_m)^2)^2
    R(f; f_0, Q) = (f f_0 / Q)^2 / ((f_0^2 - f^2)^2 + (f f_0 / Q)^2)          the rate of a resonator under white force

with slow aiming (drift), arm (2.6 Hz) and hand (9.7 Hz), and twitches that pass below f_m = 12 Hz.

Against a recording. The figures were fitted to 186 s of vigorous hand-held phone motion (gyro at 210 Hz; RMS rates 0.46, 0.62 and
0.34 rad/s in pitch, yaw and roll, which set the weights of the axes). In third-octave bands from 0.2 to 45 Hz, over five decades of
power, the model lies within 2.6 dB of the recording's mean spectrum (RMS 1.3 dB); it is 2.4 dB low at the arm's peak of 3.5 Hz and
2.6 dB high in the valley at 6 Hz. Of the rate's RMS the recording has 0.38, 0.83, 0.39 and 0.12 in the bands 0.1-2, 2-7, 7-13 and
13-30 Hz; the model 0.41, 0.81, 0.41 and 0.13. One recording is one person: read the figures as an example, not as a population.

The amplitude. Photographers who stand still hold 1 / focal length (in mm, on 36 x 24 mm film) seconds with a blur of one circle of
confusion (0.03 mm): 0.03 mm/f in 1/f s is a rate of 0.03 rad/s, whatever the lens. This is the default; the recording is 20 times it.
"""

import math

import numpy as np
from jaxtyping import Float

STEADY = 0.03  # rad/s, RMS of the fastest axis: the photographers' rule
AXES = (0.74, 1.0, 0.55)  # RMS of pitch, yaw and roll against the fastest
DRIFT = (0.016, 2.8)  # level, corner in Hz
RESONANCES = ((0.27, 2.6, 1.0), (0.09, 9.7, 3.7))  # level, frequency in Hz, quality: arm, hand
MUSCLE = 12.0  # Hz
PERIOD = 20.0  # s; the slowest component, and how soon the motion would repeat
LONGEST = 3600.0  # s
FASTEST = 100e3  # Hz
SLOWEST = 100.0  # Hz, of samples; fewer do not hold the spectrum of a hand
MOST_SAMPLES = 10_000_000  # of one shake: 240 MB of angles


def rate_spectrum(f: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """S(f): power spectral density of an axis' angular rate, per Hz, whose integral over f > 0 is 0.93."""
    drift, f_d = DRIFT
    force = drift / (1 + (f / f_d) ** 2)
    for level, f_0, quality in RESONANCES:
        damping = (f * f_0 / quality) ** 2
        force = force + level * damping / ((f_0**2 - f**2) ** 2 + damping)
    return force / (1 + (f / MUSCLE) ** 2) ** 2


def shake(rng: np.random.Generator, duration: float, rate: float, *, rms: float = STEADY) -> Float[np.ndarray, "n 3"]:
    """Pitch, yaw and roll in rad at the times k / rate, k = 0 .. ceil(duration * rate); `rms` of the yaw rate in rad/s.

    Each component of the rate's spectrum is a Gaussian with variance S(f), integrated by dividing by 2 pi i f.
    """
    if not (math.isfinite(duration) and 0 < duration <= LONGEST):
        raise ValueError(f"duration of a shake must lie in (0, {LONGEST:g}] s, got {duration:g} s; is it in milliseconds?")
    if not (math.isfinite(rate) and SLOWEST <= rate <= FASTEST):
        raise ValueError(f"rate of a shake must lie in [{SLOWEST:g}, {FASTEST:g}] Hz to hold its spectrum, got {rate:g} Hz")
    if not (math.isfinite(rms) and rms >= 0):
        raise ValueError(f"rms of a shake must be at least 0 rad/s, got {rms:g} rad/s")
    count = math.ceil(duration * rate) + 1
    if count > MOST_SAMPLES:
        raise ValueError(f"a shake has at most {MOST_SAMPLES // 10**6} million samples, got {duration:g} s at {rate:g} Hz")
    n = max(2 * count, math.ceil(PERIOD * rate))
    f = np.fft.rfftfreq(n, 1 / rate)[1:]
    power = rate_spectrum(f)
    amplitude = rms * np.sqrt(power / power.sum())
    gauss = rng.standard_normal((2, len(f), 3))
    spectrum = (gauss[0] + 1j * gauss[1]) * (amplitude / (2j * np.pi * f))[:, None] * np.array(AXES)
    angles = np.fft.irfft(np.concatenate([np.zeros((1, 3)), spectrum]), n, axis=0)[:count] * (n / 2)
    return angles - angles[0]
