"""The C library's contexts and lights: what they share, what they leave behind, in which order they are called."""

import numpy as np
from c_library import CONTEXT_LOST, NOTHING_CULLED, OK, Context, Light
from c_light import OVER, SURFACE, WHOLE, drawn
from gl_objects import alive
from host import CAMERA, SIZE, Host, projection

from gsgi.runtime.file import codec
from gsgi.runtime.gl.gaussian_textures import data_rows
from gsgi.runtime.gl.host_textures import Encoding
from gsgi.runtime.lookup_tables import lookup_tables


def test_several_contexts_and_lights_know_nothing_of_each_other(library, gl, host):
    contexts = [Context(library, gl) for _ in range(2)]
    lights = [Light(context, data, Encoding()) for context in contexts for data in (SURFACE, OVER)]
    textures = host.textures(gl, Encoding())
    pictures = [drawn(gl, light, textures) for light in lights]
    np.testing.assert_array_equal(pictures[0], pictures[2])
    np.testing.assert_array_equal(pictures[1], pictures[3])
    lights[0].destroy()
    lights[1].destroy()
    contexts[0].destroy()
    np.testing.assert_array_equal(drawn(gl, lights[2], textures), pictures[2])
    lights[2].destroy()
    lights[3].destroy()
    contexts[1].destroy()


def test_nothing_is_left_behind(fresh_gl, library):
    host = Host(fresh_gl)
    textures = host.textures(fresh_gl, Encoding())
    before = alive(fresh_gl)
    context = Context(library, fresh_gl)
    for data in (SURFACE, OVER):
        light = Light(context, data, Encoding())
        for part in (WHOLE, (0, 0, 40, 30)):
            assert light.cull(CAMERA.view_from_world, projection(part=part), part) == OK
            assert light.draw(*(made.glo for made in textures))[0] == OK
        light.destroy()
    context.destroy()
    assert alive(fresh_gl) == before


def test_after_a_lost_context_nothing_calls_opengl(fresh_gl, library):
    host = Host(fresh_gl)
    textures = host.textures(fresh_gl, Encoding())
    context = Context(library, fresh_gl)
    light = Light(context, SURFACE, Encoding())
    drawn(fresh_gl, light, textures)
    before = alive(fresh_gl)
    library.functions.gsgi_context_forget(context.handle)
    assert light.draw(*(made.glo for made in textures))[0] == CONTEXT_LOST
    assert light.add(0, 1) == light.reset() == CONTEXT_LOST
    assert Light(context, SURFACE, Encoding()).result == CONTEXT_LOST
    light.destroy()
    context.destroy()
    assert alive(fresh_gl) == before


def test_calls_come_in_an_order(gl, context, host):
    light = Light(context, SURFACE, Encoding())
    textures = host.textures(gl, Encoding())
    assert light.draw(*(made.glo for made in textures))[0] == NOTHING_CULLED
    assert light.add(0, textures[1].glo) == NOTHING_CULLED
    first = drawn(gl, light, textures)
    assert light.reset() == OK
    assert light.draw(*(made.glo for made in textures))[0] == NOTHING_CULLED
    np.testing.assert_array_equal(drawn(gl, light, textures), first)
    light.destroy()


def test_stats_are_of_the_last_cull_and_draw(gl, context, host):
    decoded, textures = codec.decode(SURFACE), host.textures(gl, Encoding())
    light = Light(context, SURFACE, Encoding(), splat_scale=2)
    stats = light.stats()
    assert (list(stats.drawn), stats.target_bytes) == ([0, 0], 0)
    drawn(gl, light, textures)
    stats, area = light.stats(), SIZE[0] * SIZE[1]
    assert list(stats.drawn) == [len(decoded.gaussians), len(decoded.coarse)]
    assert stats.gaussian_bytes == sum(data_rows(table).nbytes for table in lookup_tables(decoded))
    assert stats.target_bytes == (8 + 4) * area + (32 + 16) * area // 4
    light.reset()
    stats = light.stats()
    assert (list(stats.drawn), stats.target_bytes) == ([0, 0], 0)
    light.destroy()


def test_over_draws_what_is_in_view(gl, context, host):
    light, count = Light(context, OVER, Encoding()), len(codec.decode(OVER).gaussians)
    for part, few in ((WHOLE, False), ((0, 0, 8, 8), True)):
        assert light.cull(CAMERA.view_from_world, projection(part=part), part) == OK
        stats = light.stats()
        assert 0 < stats.drawn[0] <= count
        assert (stats.drawn[0] < count / 2) == few
        assert stats.drawn[1] == 0
    light.destroy()
