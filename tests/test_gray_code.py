"""Gray decoding: every word, with and without complements, and an honest margin where a plane is in doubt."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from ideal_camera import gray_planes, shown

from models.phase.gray_code import GrayCode, decode_gray

PERIOD = 9.0


def centres(bits: int) -> np.ndarray:
    return ((np.arange(2**bits) + 0.5) * PERIOD)[None]


@given(bits=st.integers(1, 10), albedo=st.floats(0.05, 0.9), ambient=st.floats(0.0, 0.1))
def test_every_order_decodes_against_white_and_black(bits: int, albedo: float, ambient: float) -> None:
    column = centres(bits)
    planes = shown(gray_planes(bits, PERIOD), column, albedo, ambient)
    white, black = torch.full(column.shape, ambient + albedo), torch.full(column.shape, ambient)
    code = decode_gray(planes, white=white, black=black)
    assert np.array_equal(code.order.numpy()[0], np.arange(2**bits))
    assert code.margin.min() > 0.99


def test_every_order_decodes_against_complements_under_uneven_light() -> None:
    column = centres(7)
    planes, inverse = (
        shown(gray_planes(7, PERIOD), column, 0.6, 0.1),
        shown(gray_planes(7, PERIOD, inverted=True), column, 0.6, 0.1),
    )
    flicker = torch.linspace(0.7, 1.3, 7)[:, None, None]  # lamp level differs from plane to plane
    code = decode_gray(planes * flicker, inverse=inverse * flicker)
    assert np.array_equal(code.order.numpy()[0], np.arange(128))
    assert code.margin.min() > 0.5


def test_planes_alone_decode_wherever_they_differ() -> None:
    code = decode_gray(shown(gray_planes(7, PERIOD), centres(7)))
    order, margin = code.order.numpy()[0], code.margin.numpy()[0]
    alike = np.isin(np.arange(128), (0, 85))  # 0000000 and 1111111 as Gray words
    assert np.array_equal(order[~alike], np.arange(128)[~alike])
    assert (margin[~alike] > 0.99).all()
    assert (margin[alike] == 0).all()


def test_unlit_pixels_have_no_margin() -> None:
    dark = torch.full((7, 1, 4), 0.02)
    code = decode_gray(dark, white=dark[0], black=dark[0])
    assert (code.margin == 0).all()


def blurred_code(column: np.ndarray, noise: float = 0.0) -> GrayCode:
    """Seven planes seen through a blur of one column (standard deviation)."""
    planes = shown(gray_planes(7, PERIOD), column, 0.8, 0.1, blur=1.0)
    if noise:
        planes = planes + torch.from_numpy(np.random.default_rng(0).normal(0, noise, planes.shape)).float()
    return decode_gray(planes, white=torch.full(column.shape, 0.9), black=torch.full(column.shape, 0.1))


def test_at_a_blurred_edge_the_rival_is_the_neighbouring_word() -> None:
    edges = np.arange(1, 101) * PERIOD
    for side in (-0.05, 0.05):
        code = blurred_code((edges + side)[None])
        here = np.floor((edges + side) / PERIOD)
        there = np.floor((edges - side) / PERIOD)
        assert (code.margin < 0.1).all()
        assert (code.second_margin > 0.9).all()
        assert np.array_equal(code.order.numpy()[0], here)
        assert np.array_equal(code.rival.numpy()[0], there)


@pytest.mark.parametrize("noise", [0.03, 0.08])
def test_a_wrong_word_has_no_large_margin_and_the_right_rival(noise: float) -> None:
    column = np.linspace(1, 910, 30_000)[None]
    code = blurred_code(column, noise)
    truth = np.floor(column / PERIOD)
    wrong = code.order.numpy() != truth
    assert 0.0003 < wrong.mean() < 0.1  # the noise does flip planes at the edges
    assert code.margin.numpy()[wrong].max() < 0.6
    assert (code.rival.numpy()[wrong] == truth[wrong]).all()
