"""Datasets from the simulated rig."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from drivers.simulator.mesh_file import read_mesh
from drivers.simulator.mix import mesh_scene, random_scene
from drivers.simulator.rig import SimulatedRig
from drivers.simulator.scene import Scene
from drivers.simulator.variation import varied_rig, varied_surfaces
from models.atomic import atomic_folder
from models.capture import Capture, write_capture
from models.dataset import RECORD_NAME, SAMPLES_NAME, Dataset, DatasetRecord, open_dataset, split_by_object
from models.errors import DatasetError
from models.geometry.rig import Rig
from models.patterns import PatternPlan

Progress = Callable[[int, int], None]


def sample_id(index: int) -> str:
    """Folder name of a dataset's sample."""
    return f"sample-{index:05d}"


def render_sample(
    seed: int,
    index: int,
    plan: PatternPlan,
    *,
    rig: SimulatedRig | Rig | None = None,
    meshes: Sequence[Path] = (),
    varied: bool = False,
) -> Capture:
    """Sample ``index`` of the series ``seed``, which depends on nothing else than the rig, the plan and the meshes.

    rig: the reference rig by default. meshes: files to take objects from, in turn, instead of procedural ones
    (MeshFileError where one is unreadable). varied: take another rig and other surfaces for each sample; the given
    rig's threads alone count then.
    """
    simulated = _simulated(rig)
    if varied:
        simulated = replace(varied_rig(seed, index), threads=simulated.threads)
    scene = _scene(seed, index, simulated, meshes)
    capture = simulated.render(varied_surfaces(scene, seed, index) if varied else scene, plan, (seed, index))
    settings = {**capture.record.settings, "seed": seed, "index": index}
    return replace(capture, record=capture.record.model_copy(update={"id": sample_id(index), "settings": settings}))


@lru_cache(maxsize=1)
def _default_rig() -> SimulatedRig:
    return SimulatedRig()


def _simulated(rig: SimulatedRig | Rig | None) -> SimulatedRig:
    if rig is None:
        return _default_rig()
    return SimulatedRig(rig) if isinstance(rig, Rig) else rig


def _scene(seed: int, index: int, simulated: SimulatedRig, meshes: Sequence[Path]) -> Scene:
    if not meshes:
        return random_scene(seed, index, simulated.rig)
    path = meshes[index % len(meshes)]
    return mesh_scene(seed, index, read_mesh(path), path.stem, simulated.rig)


def simulate_dataset(
    output: Path,
    samples: int,
    seed: int,
    plan: PatternPlan,
    *,
    rig: SimulatedRig | Rig | None = None,
    meshes: Sequence[Path] = (),
    varied: bool = False,
    workers: int = 1,
    progress: Progress | None = None,
) -> Dataset:
    """Render and write a dataset; the folder appears under its name only when it is complete.

    output must not exist, its parent must (DuofringeError). meshes, varied: see ``render_sample``; unreadable meshes
    are told before anything is rendered; varied samples have calibrations of their own. workers: samples in flight at
    once. progress: called with (done, samples) in the caller's thread. Object identities decide the splits: 70 / 15 /
    15, disjoint; all in "test" below three objects.
    """
    if samples < 1:
        raise DatasetError(f"a dataset needs at least one sample, not {samples}")
    if seed < 0:
        raise DatasetError(f"the seed must be zero or positive, not {seed}")
    simulated = _simulated(rig)
    for path in meshes:
        read_mesh(path)
    if workers > 1:
        simulated = replace(simulated, threads=1)
    if not varied:
        simulated.prepare(plan)
    with atomic_folder(output) as partial:
        (partial / SAMPLES_NAME).mkdir()

        def make(index: int) -> str:
            capture = render_sample(seed, index, plan, rig=simulated, meshes=meshes, varied=varied)
            write_capture(capture, partial / SAMPLES_NAME / sample_id(index))
            return capture.record.object_id or ""

        object_of: dict[str, str] = {}
        with ThreadPoolExecutor(max(1, workers)) as pool:
            try:
                for index, name in enumerate(pool.map(make, range(samples))):
                    object_of[sample_id(index)] = name
                    if progress is not None:
                        progress(index + 1, samples)
            except BaseException:
                # an interrupt must not wait for samples that nobody will get
                pool.shutdown(wait=True, cancel_futures=True)
                raise
        record = DatasetRecord.model_validate(
            {
                "calibration": None if varied else simulated.rig.to_dict(),
                "plan": plan,
                "splits": split_by_object(object_of, seed),
                "simulation": {"seed": seed, "samples": samples, "meshes": [p.name for p in meshes], "varied": varied},
            }
        )
        (partial / RECORD_NAME).write_text(record.to_json(), encoding="utf-8")
    return open_dataset(output)
