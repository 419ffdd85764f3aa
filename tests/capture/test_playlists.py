"""A video that is a list of other files and addresses is not opened, whatever it is called."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from massprops.capture.video import read_video
from massprops.errors import InputError
from massprops.simulation.simulate import write_video

LISTS = {
    "concat": "ffconcat version 1.0\nfile real.mp4\n",
    "hls": "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\nreal.mp4\n#EXT-X-ENDLIST\n",
    "sdp": "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 5004 RTP/AVP 96\na=rtpmap:96 H264/90000\n",
    "dash": """<?xml version="1.0"?>
<MPD xmlns="urn:mpeg:dash:schema:mpd:2011" type="static" mediaPresentationDuration="PT1S" minBufferTime="PT1S"
 profiles="urn:mpeg:dash:profile:isoff-on-demand:2011"><Period><AdaptationSet mimeType="video/mp4">
<Representation id="1" bandwidth="1"><BaseURL>real.mp4</BaseURL></Representation></AdaptationSet></Period></MPD>""",
}
ENDINGS = {"concat": "ffconcat", "hls": "m3u8", "sdp": "sdp", "dash": "mpd"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("videos")
    images = []
    for i in range(3):
        images.append(folder / f"{i}.png")
        cv2.imwrite(str(images[-1]), np.full((48, 64), 40 * i, np.uint8))
    write_video(folder / "real.mp4", images, 10.0)
    return folder


def test_the_real_one_is_read(folder: Path) -> None:
    assert len(list(read_video(folder / "real.mp4"))) == 3


@pytest.mark.parametrize("ending", ["own", "mp4"])
@pytest.mark.parametrize("kind", LISTS)
def test_a_list_of_others_is_refused(folder: Path, kind: str, ending: str) -> None:
    path = folder / f"{kind}_list.{ENDINGS[kind] if ending == 'own' else ending}"
    path.write_text(LISTS[kind])
    with pytest.raises(InputError, match="not a video that can be read"):
        list(read_video(path))
