"""All checks of the audio of a recording, in the order in which one fault hides another."""

import numpy as np

from avssl_pyro.acoustics.array import MicrophoneArray
from avssl_pyro.diagnosis.array_match import check_array_match
from avssl_pyro.diagnosis.channels import ChannelLevels, check_clipping, check_duplicates, check_levels, find_duplicates
from avssl_pyro.diagnosis.finding import Finding, Severity
from avssl_pyro.diagnosis.geometry import check_geometry
from avssl_pyro.errors import InputError
from avssl_pyro.recordings.excerpts import Excerpts

# The loudest excerpts tell most of directions; more of them cost time and change nothing.
EXCERPTS_TO_MATCH = 8


def examine(excerpts: Excerpts, array: MicrophoneArray) -> tuple[Finding, ...]:
    """Checks excerpts of a recording against its array.

    Dead channels and second copies are left out before channels are compared with each other.

    Raises:
        InputError: the numbers of channels and microphones differ.
    """
    if excerpts.num_channels != array.num_microphones:
        raise InputError(
            f"the recording has {excerpts.num_channels} channel(s), but array '{array.name}' has "
            f"{array.num_microphones} microphones; give the array file of this recording."
        )
    levels = ChannelLevels.of(excerpts)
    findings = [*check_geometry(array), *check_levels(excerpts, array)]
    if not levels.loud_b.any():
        return tuple(findings)
    findings += [*check_clipping(excerpts), *check_duplicates(excerpts)]
    unusable = {*levels.dead, *(second for _, second, _ in find_duplicates(excerpts))}
    if not (array.positions_m and array.steering.has_delays):
        found = f"order, signs and delays of channels cannot be checked on an array {array.steering.description}"
        return (*findings, Finding("array", Severity.NOTE, found, 1.0, "listen to the channels one by one"))
    usable = [channel for channel in range(array.num_microphones) if channel not in unusable]
    if len(usable) < 2:
        found = "fewer than two channels are left to compare"
        return (*findings, Finding("array", Severity.ERROR, found, 1.0, "mend the channels first"))
    loudest = np.argsort(-levels.power_bm[:, usable].mean(axis=1))[:EXCERPTS_TO_MATCH]
    compared = excerpts.select(usable)
    matching = check_array_match(compared.audio_bmn[np.sort(loudest)], array.select(tuple(usable)), compared.names)
    return (*findings, *matching)
