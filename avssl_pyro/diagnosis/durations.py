"""Audio and video of one recording that last differently: a wrong sample rate in the header, or a lost part."""

from itertools import permutations

from avssl_pyro.diagnosis.finding import Finding, Severity

CHECK = "durations"
COMMON_RATES = (8_000, 16_000, 22_050, 24_000, 32_000, 44_100, 48_000, 96_000)
TOLERATED_SHARE, TOLERATED_S = 0.02, 2.0
SAME_RATIO = 0.01


def check_durations(audio_s: float, rate: int, video_s: float) -> tuple[Finding, ...]:
    """Compares how long audio (of a header's sample rate) and video last."""
    if abs(audio_s - video_s) <= max(TOLERATED_S, TOLERATED_SHARE * video_s):
        return (Finding(CHECK, Severity.OK, "audio and video last about equally long", 1.0),)
    found = f"the audio lasts {audio_s:.1f} s, the video {video_s:.1f} s"
    for claimed, true in permutations(COMMON_RATES, 2):
        if claimed == rate and abs(audio_s / video_s * claimed / true - 1) < SAME_RATIO:
            slip = f"{found}: as if audio of {true} Hz were said to have {rate} Hz"
            return (Finding(CHECK, Severity.WARNING, slip, 0.8, f"set the sample rate in its header to {true} Hz"),)
    return (
        Finding(CHECK, Severity.NOTE, found, 1.0, "only what both cover is used; give an offset if one starts late"),
    )
