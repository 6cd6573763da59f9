"""Electronic data sheets: a real sensor's memory, one made field by field, and anything else."""

from __future__ import annotations

from datetime import date

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isorig.drivers.errors import ProtocolError
from isorig.drivers.teds import Teds, decode

#: Memory of a Brüel & Kjær 4507-B-005 as published with the modal analysis package SDLMA (first bit first).
PUBLISHED = bytes.fromhex("8803662228909e002601679c22a4da87224894d097620840b68001c000")


def reversed_bits(data: bytes) -> bytes:
    """The first bit of each byte as its lowest."""
    return bytes(int(f"{byte:08b}"[::-1], 2) for byte in data)


def packed(*fields: tuple[int, int]) -> bytes:
    """Fields of so many bits, lowest bit first."""
    text = "".join(f"{value:0{count}b}"[::-1] for value, count in fields)
    text += "0" * (-len(text) % 8)
    return bytes(int(text[at : at + 8][::-1], 2) for at in range(0, len(text), 8))


BASIC = ((43, 14), (3520, 15), (2, 5), (7, 6), (123456, 24))


def test_a_real_sensors_memory() -> None:
    found = decode(reversed_bits(PUBLISHED))
    assert found.serial_number == 30985
    # Its data sheet: 98 mV/(m/s^2) nominal (1 V/g), 5 %.
    assert found.sensitivity == pytest.approx(0.098, rel=0.05)
    assert (found.calibrated, found.due) == (date(2022, 11, 7), date(2023, 11, 7))


@pytest.mark.parametrize("transfer", [0, 1])
def test_every_field_is_at_its_place(transfer: int) -> None:
    extra = ((1, 7), (2, 9), (3, 9), (4, 7), (5, 6)) if transfer else ()
    data = packed(
        *BASIC, (0, 2), (25, 8), (0, 1), (0, 1), (33000, 16), (9, 8), (2, 2), (11, 6), (1, 1), (transfer, 1), *extra, (200, 8),
        (16, 5), (10227, 16), (77, 15), (730, 12), (3, 11),
    )  # fmt: skip
    assert decode(data) == Teds(
        serial_number=123456, quantity="acceleration",
        sensitivity=5e-7 * 1.0003**33000,
        calibrated=date(2026, 1, 1), due=date(2028, 1, 1),
    )  # fmt: skip


FORCE = packed(*BASIC, (0, 2), (25, 8), (1, 1), (0, 200))


@pytest.mark.parametrize(("template", "quantity"), [
    (((0, 2), (25, 8), (1, 1)), "force"), (((0, 2), (25, 8), (0, 1), (1, 1)), "acceleration"), (((0, 2), (33, 8), (0, 1)), ""),
    (((1, 2), (0, 8), (0, 1)), ""),
])  # fmt: skip
def test_of_other_templates_the_basic_part_is_read(template: tuple[tuple[int, int], ...], quantity: str) -> None:
    found = decode(packed(*BASIC, *template, (0, 200)))
    assert (found.serial_number, found.sensitivity, found.calibrated) == (123456, None, None)
    assert found.quantity == quantity


def test_a_date_that_is_not_given_is_none() -> None:
    head = (*BASIC, (0, 2), (25, 8), (0, 2), (33000, 16), (0, 18), (0, 13))
    assert decode(packed(*head, (65535, 16), (0, 15), (365, 12))).calibrated is None
    found = decode(packed(*head, (10000, 16), (0, 15), (4095, 12)))
    assert found.calibrated is not None
    assert found.due is None


@pytest.mark.parametrize("data", [b"", bytes(32), b"\xff" * 32, b"\x01" * 7, b"\x01" * 5000])
def test_a_memory_without_a_data_sheet_is_refused(data: bytes) -> None:
    with pytest.raises(ProtocolError, match="holds no data sheet"):
        decode(data)


def test_a_memory_that_ends_too_early_is_refused() -> None:
    with pytest.raises(ProtocolError, match="ends within its data sheet"):
        decode(reversed_bits(PUBLISHED)[:14])


@settings(max_examples=300)
@given(st.binary(max_size=64))
def test_any_bytes_are_a_data_sheet_or_a_refusal(data: bytes) -> None:
    try:
        found = decode(data)
    except ProtocolError as refusal:
        assert "\n" not in str(refusal)  # noqa: PT017
    else:
        assert found.sensitivity is None or found.sensitivity > 0.0
