"""Marks of tests that draw with the real viewer."""

from pathlib import Path

import pytest

_DRIVERS = [
    *Path("/usr/share/vulkan/icd.d").glob("*.json"),
    *Path("/etc/vulkan/icd.d").glob("*.json"),
]
VIEWER = [
    pytest.mark.viewer,
    pytest.mark.skipif(
        not _DRIVERS, reason="no Vulkan driver; Debian: apt-get install mesa-vulkan-drivers"
    ),
]
