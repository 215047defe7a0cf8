"""`blender --command extension` for Blender as a Python module (`bpy`), which has no command line: `python command.py build --help`."""

import os
import sys

import bpy
from bl_pkg import bl_extension_cli

assert bpy.app.background
code = 1
try:
    code = bl_extension_cli.cli_extension_handler(sys.argv[1:])
except SystemExit as end:
    code = end.code if isinstance(end.code, int) else int(end.code is not None)
finally:
    # Exits at once, since Blender may crash during its cleanup.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
