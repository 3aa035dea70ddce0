"""Stills of episodes for paper: strips of frames, and routes over maps."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from sympol.envs.minigrid import TASKS, random_layouts
from sympol.envs.minigrid.cells import OBJECTS
from sympol.envs.registry import resolve
from sympol.film.stills import COLOURS, Map, Route, contact_sheet, draw_routes

SHADES = [Image.new("RGB", (96, 48), (60 * i, 255 - 60 * i, 0)) for i in range(4)]
WORLD = (("wall", "empty", "goal"), ("lava", "empty", "empty"))


def test_a_strip_goes_from_left_to_right_and_from_the_top_down():
    picture = contact_sheet(SHADES, ["a", "b", "c", "d"], columns=3, width=96).convert("RGB")
    assert picture.width == 3 * 96 + 4 * 10
    middles = [(10 + 48, 34), (116 + 48, 34), (222 + 48, 34), (10 + 48, picture.height - 60)]
    assert [picture.getpixel(middle) for middle in middles] == [shade.getpixel((0, 0)) for shade in SHADES]
    assert picture.getpixel((222 + 48, picture.height - 60)) == (255, 255, 255)


def test_a_strip_says_words_below_each_frame():
    said, silent = (contact_sheet(SHADES[:1], [words]) for words in ("turn left", ""))
    assert said.size == silent.size
    assert said.tobytes() != silent.tobytes()


@pytest.mark.parametrize(("frames", "words"), [([], []), (SHADES, ["one"])])
def test_a_strip_needs_words_for_its_frames(frames, words):
    with pytest.raises(ValueError, match="words for each frame"):
        contact_sheet(frames, words)


def colours_in(picture: Image.Image) -> np.ndarray:
    return np.unique(np.asarray(picture.convert("RGB")).reshape(-1, 3), axis=0)


def has(picture: Image.Image, colour: str) -> bool:
    return bool((np.abs(colours_in(picture) - 255 * np.array(to_rgb(colour))).max(axis=1) <= 12).any())


def test_each_route_has_its_colour():
    routes = [Route([(1, 0), (1, 1)], arrives=False), Route([(1, 0), (2, 0)], arrives=True)]
    for shown in range(3):
        picture = draw_routes([Map(WORLD, routes[:shown])])
        assert [has(picture, colour) for colour in COLOURS] == [shown > 0, shown > 1]


def test_arriving_is_seen_and_standing_still_is_drawn():
    pictures = [
        draw_routes([Map(WORLD, [Route([(1, 0)] * 3, arrives=arrives)])]) for arrives in (True, False)
    ]
    assert pictures[0].tobytes() != pictures[1].tobytes()


def test_maps_stand_in_rows_with_room_for_titles_and_names():
    one = draw_routes([Map(WORLD, [])])
    titled, named = draw_routes([Map(WORLD, [], "$_^")]), draw_routes([Map(WORLD, [])], names=["a", "b"])
    assert titled.width == named.width == one.width
    assert min(titled.height, named.height) > one.height
    three = draw_routes([Map(WORLD, [])] * 3, columns=2)
    assert three.width > 1.5 * one.width
    assert three.height > 1.5 * one.height


def test_at_most_two_routes_can_be_told_apart():
    route = Route([(1, 0)], arrives=False)
    for maps in ([], [Map(WORLD, [route] * 3)]):
        with pytest.raises(ValueError, match="at most two routes"):
            draw_routes(maps)


def test_the_rows_of_a_world_are_those_of_its_grid():
    pytest.importorskip("minigrid")
    from sympol.envs.minigrid.host import rows_of

    name = "sympol/DistShift-Random-v0"
    make = resolve(name, backend="host").make_host
    assert make is not None
    env, grids = make(), TASKS[name].grids()
    for (row, goal), grid in list(zip(random_layouts(), grids, strict=True))[::11]:
        env.reset(options={"strip2_row": row, "goal": goal})
        shown = [[int(np.log2(cell & 0x7FF)) for cell in cells] for cells in grid]
        assert rows_of(env) == [[OBJECTS[number] for number in cells] for cells in shown]
