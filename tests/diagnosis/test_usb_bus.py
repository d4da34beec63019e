"""Devices, rules and memory as a made-up system shows them."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up_host import CAMERA, PROJECTOR, RULE, MadeUpHost

from service.diagnosis.usb_bus import UsbId, attached, has_rule, usbfs_memory_mb

FLIR, LIGHTCRAFTER = UsbId("1e10"), UsbId("0451", "6401")
SHIPPED = Path(__file__).parents[2] / "docker" / "99-duofringe.rules"


@pytest.fixture
def made_up(tmp_path: Path) -> MadeUpHost:
    return MadeUpHost(tmp_path)


def test_devices_are_found_with_link_and_node(made_up: MadeUpHost) -> None:
    node = made_up.attach(CAMERA, "0138C343")
    made_up.attach(PROJECTOR, speed="12")
    made_up.attach(("0451", "8142"))
    (camera,) = attached(FLIR, made_up.root)
    assert (camera.serial, camera.speed_mbps, camera.node) == ("0138C343", 5000.0, node)
    (projector,) = attached(LIGHTCRAFTER, made_up.root)
    assert (str(projector.id), projector.speed_mbps) == ("0451:6401", 12.0)


def test_an_empty_system_has_nothing(tmp_path: Path) -> None:
    assert attached(FLIR, tmp_path) == []
    assert not has_rule(FLIR, tmp_path)
    assert usbfs_memory_mb(tmp_path) is None


def test_a_link_whose_speed_is_not_told(made_up: MadeUpHost) -> None:
    made_up.attach(CAMERA, speed="unknown")
    assert attached(FLIR, made_up.root)[0].speed_mbps is None


@pytest.mark.parametrize("folder", ["etc/udev/rules.d", "run/udev/rules.d", "usr/lib/udev/rules.d", "lib/udev/rules.d"])
def test_rules_are_looked_for_where_udev_does(made_up: MadeUpHost, folder: str) -> None:
    made_up.add_rules(f"# cameras\n{RULE}", folder)
    assert has_rule(FLIR, made_up.root)
    assert not has_rule(LIGHTCRAFTER, made_up.root)


def test_the_shipped_file_serves_both(made_up: MadeUpHost) -> None:
    made_up.add_rules(SHIPPED.read_text())
    assert has_rule(FLIR, made_up.root)
    assert has_rule(LIGHTCRAFTER, made_up.root)


@pytest.mark.parametrize(
    "text",
    [
        f"#{RULE}",
        'SUBSYSTEM=="usb", ATTR{idVendor}=="1e10", SYMLINK+="camera"\n',
        'SUBSYSTEM=="usb", ATTR{idVendor}!="1e10", MODE="0666"\n',
        'SUBSYSTEM=="usb", ATTR{idVendor}=="1e10", ATTR{idProduct}=="3300", MODE="0666"\n',
        'SUBSYSTEM=="usb", ATTR{idVendor}=="1e1", MODE="0666"\n',
        "",
    ],
    ids=["comment", "no access", "all others", "one product", "another vendor", "empty"],
)
def test_what_is_no_rule_for_it(made_up: MadeUpHost, text: str) -> None:
    made_up.add_rules(text)
    assert not has_rule(FLIR, made_up.root)


def test_rules_for_a_whole_vendor_and_over_two_lines_count(made_up: MadeUpHost) -> None:
    made_up.add_rules('SUBSYSTEM=="usb", \\\n ATTRS{idVendor}=="0451", TAG+="x", MODE:="0666"\n')
    assert has_rule(LIGHTCRAFTER, made_up.root)


def test_a_file_of_the_administrator_hides_its_namesake(made_up: MadeUpHost) -> None:
    made_up.add_rules(RULE, "usr/lib/udev/rules.d", "60-cameras.rules")
    made_up.add_rules("", "etc/udev/rules.d", "60-cameras.rules")
    assert not has_rule(FLIR, made_up.root)


@given(text=st.text(alphabet=st.sampled_from(RULE + "#\\!+:\n'"), max_size=200))
def test_any_text_may_stand_in_a_rules_file(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    """Nothing of it makes the parser fail or hides a good rule on a later line."""
    made_up = MadeUpHost(tmp_path_factory.mktemp("host"))
    made_up.add_rules(text.replace("\\", "") + "\n" + RULE)
    assert has_rule(FLIR, made_up.root)


@pytest.mark.parametrize(("text", "told"), [("16\n", 16), ("0\n", 0), ("1000", 1000), ("many", None), ("", None)])
def test_memory(made_up: MadeUpHost, text: str, told: int | None) -> None:
    made_up.write("sys/module/usbcore/parameters/usbfs_memory_mb", text)
    assert usbfs_memory_mb(made_up.root) == told
