"""Search for repairs that make an array fit a recording.

Repairs are exchanges, inversions, delays and rescalings. Candidates come from the symmetry of the array (exchanges),
the delays of pairs, and the prediction of each channel by the others. The search is greedy: it applies the repair with
the largest mean gain in likelihood over the excerpts, and repeats until no repair helps.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.diagnosis.array_fit import ArrayFit, FitConfig, Residual
from avssl_pyro.diagnosis.finding import Finding, Severity, channels
from avssl_pyro.diagnosis.geometry import exchange_classes
from avssl_pyro.diagnosis.pair_delays import PairDelays, longest_delays
from avssl_pyro.diagnosis.repairs import (
    Audio,
    Delay,
    Exchange,
    Inversion,
    Repair,
    Rescaling,
    possible,
)

CHECK = "array"
# Least gain of a repair in nats per time-frequency bin and microphone.
LEAST_GAIN = 0.004
LEAST_AGREEMENT = 0.95
# Temperature, elevation and near talkers explain shorter delays (seconds) and smaller scale factors.
LEAST_DELAY_S, LEAST_FACTOR = 4e-5, 1.3
# Sound from 50 degrees above the horizon makes a flat array seem 1.6 times smaller than it is.
LEAST_SHRINKAGE = 1.7
SCALE_STEP, FINE_SCALE_STEP = 1.15, 1.05
# Below this share of the median agreement, a channel does not record the sound field of the others.
DEAF_SHARE = 0.35
# With more channels than this, only those below this share of the median agreement are tried, to save time.
MOST_TO_TRY_ALL, SUSPECT_SHARE = 8, 0.85
SURE = 0.95
MOST_REPAIRS = 4
RESAMPLES = 1000


@dataclass(frozen=True)
class Proof:
    """Gain in likelihood by a repair.

    Args:
        repair: repair that was tried.
        gain_b: gain in log-likelihood in nats per bin and microphone, (B,).
    """

    repair: Repair
    gain_b: npt.NDArray[np.float64]

    @property
    def agreement(self) -> float:
        """Share of bootstrap resamples of the excerpts with a sufficient gain."""
        draws = np.random.default_rng(0).integers(0, len(self.gain_b), (RESAMPLES, len(self.gain_b)))
        return float((self.gain_b[draws].mean(axis=1) > LEAST_GAIN).mean())

    @property
    def confidence(self) -> float:
        """Agreement, bounded below 1 because few excerpts can share an error."""
        return self.agreement * (1 - 1 / (len(self.gain_b) + 2) ** 2)


class ArrayMatch:
    """Search for repairs of a recording and its array.

    Args:
        audio_bmn: excerpts at 16 kHz, (B, M, N), without dead and copied channels.
        array: array of these channels.
    """

    def __init__(self, audio_bmn: Audio, array: MicrophoneArray) -> None:
        self._audio_bmn = audio_bmn
        self._array = array
        self._fit = ArrayFit(fit_config(array))

    def repairs(self) -> list[Proof]:
        """Returns the needed repairs in the order of the search, and applies them."""
        found: list[Proof] = []
        audio_bmn, array = self._audio_bmn, self._array
        while len(found) < MOST_REPAIRS:
            before_b = self._score(audio_bmn, array)
            proofs = [
                Proof(repair, self._score(*repair.mend(audio_bmn, array)) - before_b)
                for repair in self._candidates(audio_bmn, array)
            ]
            best = max(proofs, key=lambda proof: float(proof.gain_b.mean()), default=None)
            if best is None or best.gain_b.mean() <= LEAST_GAIN or best.agreement < LEAST_AGREEMENT:
                break
            best = self._sharpened(best, before_b, audio_bmn, array)
            found.append(best)
            audio_bmn, array = best.repair.mend(audio_bmn, array)
        self._audio_bmn, self._array = audio_bmn, array
        return found

    def deaf(self) -> list[int]:
        """Returns channels that do not follow the sound field of the others.

        Call :meth:`repairs` first.
        """
        if self._array.num_microphones < 4:
            return []
        agreement_m = np.array(
            [
                self._residual(self._audio_bmn, self._array, (channel,), LEAST_DELAY_S).agreement
                for channel in range(self._array.num_microphones)
            ]
        )
        return [int(channel) for channel in np.flatnonzero(agreement_m < DEAF_SHARE * np.median(agreement_m))]

    def _sharpened(
        self, proof: Proof, before_b: npt.NDArray[np.float64], audio_bmn: Audio, array: MicrophoneArray
    ) -> Proof:
        """Refines the factor of a rescaling to a few per cent."""
        if not isinstance(proof.repair, Rescaling):
            return proof
        finer = [Rescaling(proof.repair.factor * FINE_SCALE_STEP**step) for step in range(-3, 4)]
        proofs = [
            Proof(repair, self._score(*repair.mend(audio_bmn, array)) - before_b)
            for repair in finer
            if _counts(repair.factor) and possible(repair, array)
        ]
        return max(proofs, key=lambda other: float(other.gain_b.mean()))

    def _score(self, audio_bmn: Audio, array: MicrophoneArray) -> npt.NDArray[np.float64]:
        fit = self._fit.fit(self._fit.spectrogram(audio_bmn), self._fit.steering(array))
        return fit.log_likelihood_b / array.num_microphones

    def _candidates(self, audio_bmn: Audio, array: MicrophoneArray) -> list[Repair]:
        num = array.num_microphones
        pairs = PairDelays.of(audio_bmn)
        residuals = [self._residual(audio_bmn, array, (channel,)) for channel in range(num)] if num > 2 else []
        suspects = _suspects(residuals) if num > MOST_TO_TRY_ALL else set(range(num))
        candidates: list[Repair] = [
            Exchange(members[0], tuple(members[1:]))
            for members in exchange_classes(array)[1:]
            if any(suspects.issuperset(pair) for pair in members)
        ]
        # With two channels, either inversion has the same effect.
        candidates += [Inversion(channel) for channel in sorted(suspects)[: 1 if num == 2 else num]]
        candidates += self._late_groups(audio_bmn, array, pairs)
        candidates += [
            Delay((channel,), residual.delay_s)
            for channel, residual in enumerate(residuals)
            if abs(residual.delay_s) > LEAST_DELAY_S
        ]
        if num > 2:
            around = pairs.scale(array)
            factors = [around * SCALE_STEP**step for step in range(-2, 4)]
            candidates += [Rescaling(factor) for factor in factors if _counts(factor)]
        return [repair for repair in candidates if possible(repair, array)]

    def _late_groups(self, audio_bmn: Audio, array: MicrophoneArray, pairs: PairDelays) -> list[Delay]:
        """Returns delays beyond the array's limit, refined where others predict them."""
        delays = []
        for late, delay_s in pairs.late_groups(array):
            delays.append(Delay(late, delay_s))
            if array.num_microphones - len(late) >= 2:
                nearly_bmn, _ = delays[-1].mend(audio_bmn, array)
                delays.append(Delay(late, delay_s + self._residual(nearly_bmn, array, late).delay_s))
        return delays

    def _residual(
        self, audio_bmn: Audio, array: MicrophoneArray, compared: tuple[int, ...], longest_s: float | None = None
    ) -> Residual:
        longest_s = float(longest_delays(array).max()) if longest_s is None else longest_s
        return self._fit.residual(self._fit.spectrogram(audio_bmn), self._fit.steering(array), compared, longest_s)


def _counts(factor: float) -> bool:
    """Returns whether a rescaling exceeds what the sound field alone can explain."""
    return factor > LEAST_FACTOR or factor < 1 / LEAST_SHRINKAGE


def _suspects(residuals: Sequence[Residual]) -> set[int]:
    """Returns channels with clearly less agreement with their prediction than others."""
    agreement_m = np.array([residual.agreement for residual in residuals])
    return set(np.flatnonzero(agreement_m < SUSPECT_SHARE * np.median(agreement_m)).tolist())


def fit_config(array: MicrophoneArray) -> FitConfig:
    """Returns a configuration with frequencies suited to the array's extent.

    The highest frequency has 2.4 wavelengths across the array, within 1000 to 3500 Hz. Above, the array's beams are
    narrower than the steps of the grid.
    """
    extent_m = float(np.linalg.norm(np.ptp(array.positions, axis=0)))
    return FitConfig(high_hz=float(np.clip(2.4 * array.speed_of_sound / extent_m, 1000.0, 3500.0)))


def check_array_match(audio_bmn: Audio, array: MicrophoneArray, names: Sequence[int]) -> tuple[Finding, ...]:
    """Returns findings on exchanged, inverted, delayed or deviant channels and units.

    Args:
        audio_bmn: excerpts at 16 kHz, (B, M, N).
        array: array of these channels.
        names: channel numbers in the file, from 0.
    """
    match = ArrayMatch(audio_bmn, array)
    findings = [
        Finding(
            proof.repair.check,
            proof.repair.severity,
            proof.repair.message(names),
            proof.confidence,
            proof.repair.advice,
        )
        for proof in match.repairs()
    ]
    deaf = [names[channel] for channel in match.deaf()]
    if deaf:
        found = f"{channels(deaf)} has another sound than the other channels"
        advice = "listen to it: noise, hum or an unplugged microphone"
        findings.append(Finding(CHECK, Severity.ERROR, found, SURE, advice))
    sound = "order, signs, delays and units of the channels fit the array"
    return tuple(findings) or (Finding(CHECK, Severity.OK, sound, SURE),)
