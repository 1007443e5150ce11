"""A drive is the same to the digest whatever instructions the processor has."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.zoo.driving.driven_digests import driven_digests
from tests.zoo.models.test_models_command import build
from tests.zoo.written_checkpoints import write_network
from zoo.base.compose import compose_config

FOUND = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
# Settings of PyTorch's libraries, NumPy, OpenCV, BLAS and the C library; processors of other makers
# ignore them.
SETTINGS = {
    "AVX2": {
        "ONEDNN_MAX_CPU_ISA": "AVX2",
        "ATEN_CPU_CAPABILITY": "avx2",
        "MKL_CBWR": "COMPATIBLE",
        "OPENBLAS_CORETYPE": "Haswell",
        "OPENCV_CPU_DISABLE": "AVX512-SKX",
        "NPY_DISABLE_CPU_FEATURES": " ".join(isa for isa in FOUND if "512" in isa or "V4" in isa),
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX512VL",
    },
    "SSE4": {
        "ONEDNN_MAX_CPU_ISA": "SSE41",
        "ATEN_CPU_CAPABILITY": "default",
        "MKL_CBWR": "COMPATIBLE",
        "OPENBLAS_CORETYPE": "Nehalem",
        "OPENCV_CPU_DISABLE": "AVX512-SKX,AVX2,FP16,FMA3,AVX",
        "NPY_DISABLE_CPU_FEATURES": " ".join(FOUND),
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA,-AVX",
    },
}


@pytest.fixture(scope="module")
def with_memory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a network with memory, with large enough weights to steer."""
    torch.manual_seed(1)
    network, view = build("cnn_gru")
    with torch.no_grad():
        network.head.weight *= 20
    config = compose_config(["model=cnn_gru"])
    return write_network(tmp_path_factory.mktemp("memory") / "cnn_gru.ckpt", network, view, config)


@pytest.mark.parametrize(
    ("fewer", "names"),
    [
        ("SSE4", ["lenet"]),
        pytest.param("SSE4", ["tiny41"], marks=pytest.mark.slow),
        pytest.param("AVX2", ["lenet", "tiny41"], marks=pytest.mark.slow),
    ],
)
def test_fewer_instructions_drive_the_same(fewer: str, names: list[str], with_memory: Path) -> None:
    files = [*names, str(with_memory)]
    words = [sys.executable, "-m", "tests.zoo.driving.driven_digests", *files]
    variables = os.environ | SETTINGS[fewer]
    with subprocess.Popen(words, env=variables, stdout=subprocess.PIPE) as process:
        here = driven_digests(files)
        assert json.loads(process.communicate()[0].splitlines()[-1]) == here
    assert len({digest for digest, _, _ in here}) == len(files)
    assert all(frames > 100 and tied == "" for _, frames, tied in here)
