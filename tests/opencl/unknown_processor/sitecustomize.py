"""Makes any machine one whose processor PoCL does not know: with this folder in PYTHONPATH, for every Python below.

The name in the device's record, which its version ends with, becomes "generic", as LLVM calls what came out after it.
"""

import ctypes
import importlib.util
import sys


def forget_processor(device):
    """Point the record at "generic" where it points at the processor's name."""
    name = device.version.rpartition("-gnu-")[2].encode() + b"\0"
    with open("/proc/self/mem", "rb", buffering=0) as memory:
        for place in range(device.int_ptr, device.int_ptr + 1024, 8):
            try:
                memory.seek(ctypes.c_size_t.from_address(place).value)
                found = memory.read(len(name))
            except (OSError, OverflowError, ValueError):
                continue
            if found == name:
                ctypes.c_size_t.from_address(place).value = ctypes.addressof(GENERIC)


GENERIC = ctypes.create_string_buffer(b"generic")


class Hook:
    """Sees to it when pyopencl is imported."""

    def find_spec(self, name, path, target=None):
        """Find pyopencl as it would be found without this."""
        if name != "pyopencl":
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        load = spec.loader.exec_module

        def load_and_forget(module):
            load(module)
            # The record is there from the first look at platforms on, and is looked at once.
            for platform in module.get_platforms():
                for device in platform.get_devices():
                    forget_processor(device)

        spec.loader.exec_module = load_and_forget
        return spec


sys.meta_path.insert(0, Hook())
