"""Pictures after H.264 compression, which phones and most cameras use."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction

import numpy as np

Array = np.ndarray


def compressed(pictures: Sequence[Array], quality_crf: float) -> Iterator[Array]:
    """BGR pictures (height, width, 3), even in size, encoded as one film and decoded again.

    quality_crf : constant rate factor of x264; 18 looks like the original, 28 gives small files
    """
    import av

    if not pictures:
        return
    encoder = av.CodecContext.create("libx264", "w")
    decoder = av.CodecContext.create("h264", "r")
    assert isinstance(encoder, av.VideoCodecContext) and isinstance(decoder, av.VideoCodecContext)
    encoder.height, encoder.width = pictures[0].shape[:2]
    encoder.pix_fmt, encoder.time_base = "yuv420p", Fraction(1, 30)
    # one thread: the pictures must not depend on the machine
    encoder.thread_count = decoder.thread_count = 1
    encoder.options = {"preset": "veryfast", "crf": f"{quality_crf:g}"}
    packets = []
    for number, picture in enumerate(pictures):
        frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
        frame.pts = number
        packets += encoder.encode(frame)
    for packet in [*packets, *encoder.encode(None), None]:
        for frame in decoder.decode(packet):
            yield frame.to_ndarray(format="bgr24")
