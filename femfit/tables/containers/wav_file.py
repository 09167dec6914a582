"""WAV recordings of a sound card: channels in parts of full scale, the time from the sample rate."""

import io
from dataclasses import replace

import numpy as np
from scipy.io import wavfile

from femfit.tables.containers.named_table import NamedTable, table_of_columns

_FULL_SCALE = {"int16": 2.0**15, "int32": 2.0**31, "int64": 2.0**63}
"""Integers of 24 bits are read shifted up to 32."""


def read_wav(content: bytes, source: str) -> tuple[list[NamedTable], str]:
    """The one table of a recording: ``time_s`` and ``channel 1`` to ``channel n``, each from -1 to 1."""
    rate, samples = wavfile.read(io.BytesIO(content))
    samples = samples.reshape(len(samples), -1)
    if samples.dtype == np.uint8:
        scaled = (samples - 128.0) / 128.0
    else:
        scaled = samples / _FULL_SCALE.get(samples.dtype.name, 1.0)
    columns = {"time_s": np.arange(len(scaled)) / rate}
    columns |= {f"channel {k + 1}": scaled[:, k] for k in range(scaled.shape[1])}
    table = table_of_columns("samples", columns, source, f"WAV of {rate} samples a second")
    note = "the channels are parts of full scale, -1 to 1; a number as unit, --unit 'channel 1=2.5', is the gain"
    return [replace(table, raw=replace(table.raw, notes=(note,)))], ""
