# SPDX-License-Identifier: Apache-2.0
"""The build backend (PEP 517): CMake builds the extension, this makes the wheel. It needs nothing
but Python and what `scripts/setup python` installs."""
import base64
import hashlib
import os
import re
import subprocess
import sysconfig
import tempfile
import zipfile

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def _version():
    with open(os.path.join(ROOT, "include/splatguard/version.h"), encoding="utf-8") as header:
        text = header.read()
    return ".".join(re.search(rf"SG_VERSION_{part} (\d+)", text)[1]
                    for part in ("MAJOR", "MINOR", "PATCH"))


def _metadata():
    return (f"Metadata-Version: 2.1\nName: splatguard\nVersion: {_version()}\n"
            "Summary: 3D Gaussian Splatting from untrusted photos\nLicense: Apache-2.0\n"
            "Requires-Python: >=3.9\n")


def _tag():
    return "cp39-abi3-" + sysconfig.get_platform().replace("-", "_").replace(".", "_")


def _build():
    """Builds in build-python, which later builds reuse; returns the extension's path."""
    folder = os.path.join(ROOT, "build-python")
    run = lambda *args: subprocess.run(args, check=True)
    run("cmake", "-S", ROOT, "-B", folder, "-G", "Ninja", "-DBUILD_TESTING=OFF", "-DSG_PYTHON=ON",
        "-DCMAKE_BUILD_TYPE=Release", "-DSG_PYTHON_INCLUDE=" + sysconfig.get_path("include"))
    run("cmake", "--build", folder, "--target", "splatguard_python")
    return os.path.join(folder, "python/splatguard/_core.abi3.so")


def get_requires_for_build_wheel(config_settings=None):
    return []


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    name = f"splatguard-{_version()}.dist-info"
    os.makedirs(os.path.join(metadata_directory, name))
    with open(os.path.join(metadata_directory, name, "METADATA"), "w", encoding="utf-8") as out:
        out.write(_metadata())
    return name


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    files = {"splatguard/_core.abi3.so": open(_build(), "rb").read()}
    package = os.path.join(ROOT, "python/splatguard")
    for name in ("__init__.py", "__init__.pyi", "py.typed"):
        with open(os.path.join(package, name), "rb") as file:
            files["splatguard/" + name] = file.read()
    info = f"splatguard-{_version()}.dist-info/"
    files[info + "METADATA"] = _metadata().encode()
    files[info + "WHEEL"] = (f"Wheel-Version: 1.0\nGenerator: splatguard\n"
                             f"Root-Is-Purelib: false\nTag: {_tag()}\n").encode()
    with open(os.path.join(ROOT, "LICENSE"), "rb") as file:
        files[info + "LICENSE"] = file.read()
    record = "".join(
        f"{name},sha256={base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b'=').decode()}"
        f",{len(data)}\n" for name, data in files.items())
    files[info + "RECORD"] = (record + info + "RECORD,,\n").encode()
    wheel = f"splatguard-{_version()}-{_tag()}.whl"
    with tempfile.NamedTemporaryFile(dir=wheel_directory, delete=False) as out:
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in files.items():
                entry = zipfile.ZipInfo(name)  # a fixed time: the same wheel each time
                entry.external_attr = (0o755 if name.endswith(".so") else 0o644) << 16
                entry.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(entry, data)
    os.chmod(out.name, 0o644)
    os.rename(out.name, os.path.join(wheel_directory, wheel))
    return wheel
