"""Chunks: the points of samples that are drawn together, and the layers of paths from them."""

from .budget import FREE_LAYERS, PATHS_STEP, free_count, known_counts, sample_count

# Points that are drawn together: so many in the first chunk, and times SIZES in those that follow, the last for all
# further ones. Small bakes need no more than their first chunks, and devices and farms want large ones.
CHUNK, SIZES = 1 << 14, (1, 1, 2, 4)


def surface_layers(budget: int, paths: int) -> list[int]:
    """Layers of each chunk of surface samples for a budget of Gaussians, with at least `paths` paths per sample.

    A layer is PATHS_STEP paths from each point of a chunk, half of them for each half of B.
    """
    return [_layer_count(paths)] * _chunk_count(sample_count(budget))


def free_layers(budget: int, paths: int) -> list[int]:
    """The same for the samples in free space: few layers of each, since more places gain more than more paths."""
    return [min(_layer_count(paths), FREE_LAYERS)] * _chunk_count(free_count(budget))


def chunk_size(number: int) -> int:
    """Number of points of the chunk with this number, from 0."""
    return CHUNK * SIZES[min(number, len(SIZES) - 1)]


def point_count(layers: list[int]) -> int:
    """Number of points of the first chunks, with so many layers each."""
    return sum(map(chunk_size, range(len(layers))))


def path_count(layers: list[int]) -> int:
    """Number of paths of the first chunks, with so many layers each."""
    return PATHS_STEP * sum(chunk_size(number) * count for number, count in enumerate(layers))


def _chunk_count(count: int) -> int:
    """Number of chunks that have at least so many points; at least one."""
    number, points = 1, chunk_size(0)
    while points < count:
        points += chunk_size(number)
        number += 1
    return number


def known_rounds(bounces: int, gaussians: int) -> tuple[list[int], ...]:
    """The layers of each round before the samples, in a scene whose shapes call for so many `gaussians`.

    Before the samples, B is traced twice at other points of the same surfaces: first by whole paths, then by paths that
    end where they meet the light of the round before, which leaves far less noise. Paths without a bounce meet no
    surface whose B they could need.
    """
    rounds = tuple([1] * _chunk_count(count) for count in known_counts(gaussians))
    return rounds[max(len(rounds) - bounces, 0) :]


def _layer_count(paths: int) -> int:
    return max(-(-paths // PATHS_STEP), 1)
