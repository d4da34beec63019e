"""The camera's own description of its features: GenICam XML from the table of features."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from xml.sax.saxutils import escape

from drivers.gigevision.features import Condition, Feature
from drivers.gigevision.protocol import PIXEL_FORMATS, Bootstrap

_HEAD = (
    '<?xml version="1.0" encoding="utf-8"?>\n'
    '<RegisterDescription ModelName="{model}" VendorName="{vendor}" ToolTip="" StandardNameSpace="GEV" '
    'SchemaMajorVersion="1" SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" '
    'SubMinorVersion="0" ProductGuid="6f2d1f3e-3c55-4f0e-9d49-51b50e1c0001" '
    'VersionGuid="6f2d1f3e-3c55-4f0e-9d49-51b50e1c0002" xmlns="http://www.genicam.org/GenApi/Version_1_1" '
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">'
)
_TRANSPORT = {
    "GevHeartbeatTimeout": Bootstrap.HEARTBEAT_MS,
    "GevTimestampTickFrequency": Bootstrap.TICKS_LOW,
    "GevSCPHostPort": Bootstrap.STREAM_PORT,
    "GevSCPSPacketSize": Bootstrap.PACKET_SIZE,
    "GevSCPD": Bootstrap.PACKET_DELAY,
    "GevSCDA": Bootstrap.STREAM_ADDRESS,
}
_TEXTS = {
    "DeviceVendorName": (Bootstrap.VENDOR, 32),
    "DeviceModelName": (Bootstrap.MODEL, 32),
    "DeviceVersion": (Bootstrap.FIRMWARE, 32),
    "DeviceFirmwareVersion": (Bootstrap.FIRMWARE, 32),
    "DeviceSerialNumber": (Bootstrap.SERIAL, 16),
    "DeviceID": (Bootstrap.SERIAL, 16),
}


def genicam_xml(features: Sequence[Feature], addresses: Mapping[str, int], vendor: str, model: str) -> bytes:
    """The description as bytes. addresses: where each feature's register lies."""
    lines = [
        _HEAD.format(model=escape(model), vendor=escape(vendor)),
        '<Category Name="Root" NameSpace="Standard">',
        *(f"<pFeature>{name}</pFeature>" for name in _TEXTS),
        *(f"<pFeature>{feature.name}</pFeature>" for feature in features),
        "</Category>",
    ]
    for name, (address, size) in _TEXTS.items():
        lines.append(
            f'<StringReg Name="{name}"><Address>0x{address:x}</Address><Length>{size}</Length>'
            "<AccessMode>RO</AccessMode><pPort>Device</pPort></StringReg>"
        )
    for name, address in _TRANSPORT.items():
        masked = name == "GevSCPSPacketSize"
        lines.append(_masked(name, address) if masked else _integer_register(name, address, "RW"))
    for feature in features:
        lines += _feature(feature, addresses[feature.name])
    lines += ['<Port Name="Device" NameSpace="Standard"></Port>', "</RegisterDescription>"]
    return "\n".join(lines).encode()


def _feature(feature: Feature, address: int) -> Iterator[str]:
    name = feature.name
    common = "".join(
        (
            f"<pIsAvailable>{name}Available</pIsAvailable>" if feature.available else "",
            f"<pIsLocked>{name}Locked</pIsLocked>" if feature.locked else "",
            f"<pValue>{name}Reg</pValue>",
        )
    )
    if feature.kind == "integer":
        yield (
            f'<Integer Name="{name}" NameSpace="Standard">{common}<Min>{feature.minimum:.0f}</Min>{_maximum(feature)}'
            f"<Inc>{feature.step:.0f}</Inc></Integer>"
        )
    elif feature.kind == "float":
        yield (
            f'<Float Name="{name}" NameSpace="Standard">{common}<Min>{feature.minimum}</Min>'
            f"<Max>{feature.maximum}</Max><Unit>{feature.unit}</Unit></Float>"
        )
    elif feature.kind == "boolean":
        yield f'<Boolean Name="{name}" NameSpace="Standard">{common}</Boolean>'
    elif feature.kind == "command":
        yield f'<Command Name="{name}" NameSpace="Standard">{common}<CommandValue>1</CommandValue></Command>'
    else:
        entries = "".join(
            f'<EnumEntry Name="{entry}" NameSpace="Standard"><Value>{entry_value(feature, index)}</Value></EnumEntry>'
            for index, entry in enumerate(feature.entries)
        )
        yield f'<Enumeration Name="{name}" NameSpace="Standard">{_enumeration_links(common, entries)}</Enumeration>'
    if feature.kind == "float":
        yield (
            f'<FloatReg Name="{name}Reg"><Address>0x{address:x}</Address><Length>8</Length>'
            f"<AccessMode>{feature.access}</AccessMode><pPort>Device</pPort><Endianess>BigEndian</Endianess></FloatReg>"
        )
    else:
        yield _integer_register(f"{name}Reg", address, feature.access)
    if feature.less:
        yield _knife(f"{name}Max", {"X": feature.less}, f"{feature.maximum:.0f} - X")
    if feature.available:
        yield _conditions(f"{name}Available", (feature.available,))
    if feature.locked:
        yield _conditions(f"{name}Locked", feature.locked)


def entry_value(feature: Feature, index: int) -> int:
    """The number behind an enumeration's entry."""
    return PIXEL_FORMATS[feature.entries[index]] if feature.name == "PixelFormat" else index


def _enumeration_links(common: str, entries: str) -> str:
    before, value = common.split("<pValue>")
    return f"{before}{entries}<pValue>{value}"


def _maximum(feature: Feature) -> str:
    return f"<pMax>{feature.name}Max</pMax>" if feature.less else f"<Max>{feature.maximum:.0f}</Max>"


def _conditions(name: str, conditions: Sequence[Condition]) -> str:
    letters = "ABCDEF"[: len(conditions)]
    terms = (f"({x} {'=' if c.equal else '<>'} {c.value})" for x, c in zip(letters, conditions, strict=True))
    return _knife(name, dict(zip(letters, (c.feature for c in conditions), strict=True)), " || ".join(terms))


def _knife(name: str, variables: Mapping[str, str], formula: str) -> str:
    links = "".join(f'<pVariable Name="{x}">{feature}Reg</pVariable>' for x, feature in variables.items())
    return f'<IntSwissKnife Name="{name}">{links}<Formula>{escape(formula)}</Formula></IntSwissKnife>'


def _integer_register(name: str, address: int, access: str) -> str:
    return (
        f'<IntReg Name="{name}"><Address>0x{address:x}</Address><Length>4</Length><AccessMode>{access}</AccessMode>'
        "<pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>"
    )


def _masked(name: str, address: int) -> str:
    """The packet size is the low half of its register; GigE Vision counts bits from the highest."""
    return (
        f'<MaskedIntReg Name="{name}"><Address>0x{address:x}</Address><Length>4</Length><AccessMode>RW</AccessMode>'
        "<pPort>Device</pPort><LSB>31</LSB><MSB>16</MSB><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess>"
        "</MaskedIntReg>"
    )
