"""Contract tests for drivers: what every camera and every projector must do, ready to run on a new one.

For authors of drivers; needs pytest and hypothesis (the extra ``dev``), and nothing that runs imports it. A driver
passes when this does, with a fake of its library or the device itself on the desk:

```python
class TestMyCamera(CameraContract):
    @pytest.fixture
    def bench(self) -> CameraBench:
        wire = FakeWire()
        return CameraBench(MyCamera("left camera", wire), pulse=wire.pulse, unplug=wire.cut, plug=wire.mend)
```

CameraContract: every promise of drivers/camera.py. ProjectorContract: of drivers/projector.py. RigContract: two
cameras and a projector on one trigger line. camera_machine: a random walk of calls over a camera and a projector,
``TestMyWalk = camera_machine(make_benches).TestCase``. A bench without ``pulse`` or ``unplug`` skips what needs them.
"""

from __future__ import annotations

import pytest

pytest.register_assert_rewrite(
    *(
        f"{__name__}.{module}"
        for module in (
            "camera_frames",
            "camera_loss",
            "camera_settings",
            "camera_states",
            "projector_loss",
            "projector_sequences",
            "projector_states",
            "expect",
            "rig_contract",
            "stateful",
        )
    )
)

from drivers.testing.bench import CameraBench, ProjectorBench  # noqa: E402
from drivers.testing.camera_contract import CameraContract  # noqa: E402
from drivers.testing.projector_contract import ProjectorContract  # noqa: E402
from drivers.testing.rig_contract import RigContract  # noqa: E402
from drivers.testing.stateful import camera_machine  # noqa: E402

__all__ = [
    "CameraBench",
    "CameraContract",
    "ProjectorBench",
    "ProjectorContract",
    "RigContract",
    "camera_machine",
]
