"""Light is traced once, and counts in each bake with the seconds that it took."""

import time
from dataclasses import dataclass

import numpy as np
import pytest
from repository import SCENES

from gsgi.baker.cache.store import MemoryCache
from gsgi.baker.progress import Silent
from gsgi.baker.trace.tracer import PASS_SAMPLES, Sampling
from gsgi.baker.tradeoff.cold_tracer import ColdProgress, ColdTracer
from gsgi.runtime.gltf.reader import read_gltf

TAKES = 0.3  # s


@dataclass(frozen=True)
class Record:
    values: np.ndarray


def slow() -> Record:
    time.sleep(TAKES)
    return Record(np.arange(3))


@pytest.fixture
def tracer() -> ColdTracer:
    return ColdTracer(read_gltf(SCENES / "cornell.glb"), MemoryCache())


def staged(tracer: ColdTracer) -> tuple[float, float, bool]:
    """The seconds of a stage that does what is slow, as it counts and as it took, and whether that had been kept."""
    key = tracer.key("slow", __name__)
    progress, start = ColdProgress(Silent(), tracer), time.perf_counter()
    with progress.stage("irradiance"):
        record, found = tracer.once(key, Record, slow)
    np.testing.assert_array_equal(record.values, np.arange(3))
    return progress.seconds["irradiance"], time.perf_counter() - start, found


def test_what_was_kept_counts_with_the_seconds_that_it_took(tracer):
    first, again = staged(tracer), staged(tracer)
    assert not first[2]
    assert again[2]
    assert again[1] < TAKES <= first[1]
    assert again[0] == pytest.approx(first[0], abs=0.5 * TAKES)


def test_a_record_without_its_seconds_is_computed_anew(tracer):
    staged(tracer)
    key = tracer.key("slow", __name__)
    tracer.kept.remove(f"seconds-{key.rpartition('-')[2]}")
    assert not staged(tracer)[2]


def test_views_are_traced_once_for_all_fits(tracer):
    cameras, said, seconds = list(tracer.scene.cameras.values()), [], []
    for _ in range(2):
        progress = ColdProgress(Silent(), tracer)
        with progress.stage("irradiance") as advance:
            tracer.views(cameras, 8, Sampling(PASS_SAMPLES), 0, advance, said.append)
        seconds.append(progress.seconds["irradiance"])
    assert said == [f"{len(cameras)} of {len(cameras)} views from the cache"]
    assert seconds[1] > 0.5 * seconds[0]


def test_finished_fits_are_not_found(tracer):
    tracer.cache.put("fit-" + "0" * 40, {"values": np.arange(3)})
    assert tracer.cache.get("fit-" + "0" * 40) is None
