"""Check of the orientation of the camera relative to the array."""

from collections.abc import Sequence

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.clip import Clip
from avssl_pyro.diagnosis.finding import Finding, Severity
from avssl_pyro.diagnosis.geometry import is_mirror_blind
from avssl_pyro.diagnosis.orientation import Orientation, OrientationSearch, Turn
from avssl_pyro.systems.system import System

CHECK = "camera"
AS_IT_IS = Turn(mirror=False, yaw_deg=0.0)
TOLERATED_DEG = 5.0
# A lower confidence does not support a finding.
LEAST_CONFIDENCE = 0.9
LEAST_CLIPS = 8


def check_camera(
    system: System, clips: Sequence[Clip], given: Turn = AS_IT_IS, progress: bool = False
) -> tuple[Finding, ...]:
    """Returns findings on the yaw and mirroring of the camera relative to the array.

    Args:
        system: trained system.
        clips: clips of one recording, with pictures already turned as given.
        given: turn that was already applied to the pictures.
        progress: switch of the progress bar.
    """
    sounding = [clip for clip in clips if clip.audio_mn.any()]
    if len(sounding) < LEAST_CLIPS:
        found = f"the turn of the camera is undetermined from {len(sounding)} clips: {LEAST_CLIPS} are needed"
        return (Finding(CHECK, Severity.NOTE, found, 0.5, "give a longer recording"),)
    return judge(orientation_search(system).search(sounding, progress), system.config.array, given)


def orientation_search(system: System) -> OrientationSearch:
    """Builds the orientation search of a trained system."""
    config = system.config
    return OrientationSearch(
        system.guide, system.model.template_dfmm, config.stft, config.model.diffuse, config.model.sigma
    )


def judge(orientation: Orientation, array: MicrophoneArray, given: Turn = AS_IT_IS) -> tuple[Finding, ...]:
    """Returns the findings for an estimated orientation.

    Args:
        orientation: estimate for the pictures as given.
        array: array of the recording.
        given: turn that was already applied to the pictures.
    """
    if is_mirror_blind(array):
        found = "mirroring and turn of the picture are undetermined: both sides of this array sound alike"
        return (Finding(CHECK, Severity.NOTE, found, 1.0, "compare camera and array by eye"),)
    best, confidence = Turn(orientation.mirror, orientation.yaw_deg), orientation.yaw_confidence
    if confidence < LEAST_CONFIDENCE:
        rival = _turned(orientation.rival)
        found = f"the turn of the camera is undetermined: {_turned(best)} fits best, but {rival} nearly as well"
        advice = (
            "record a minute with somebody who walks around the array and talks (two who stand still sound right in a "
            "mirrored picture too), or use a model trained on such pictures"
        )
        return (Finding(CHECK, Severity.NOTE, found, confidence, advice),)
    if not best.mirror and abs(best.yaw_deg) <= TOLERATED_DEG:
        return (Finding(CHECK, Severity.OK, "picture and sound agree: neither turned nor mirrored", confidence),)
    found = f"the picture is {_turned(best)} against the array"
    whole = given.then(best)
    advice = f"read the recording with a yaw of {whole.yaw_deg:.0f} deg, {'' if whole.mirror else 'not '}mirrored"
    return (Finding(CHECK, Severity.WARNING, found, confidence, advice),)


def _turned(turn: Turn) -> str:
    turned = f"turned by {turn.yaw_deg:+.0f} deg"
    return f"mirrored and {turned}" if turn.mirror else turned
