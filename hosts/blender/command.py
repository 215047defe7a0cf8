"""`blender --command extension` for those who have Blender as a Python module: `python command.py build --help`.

The module has no command line, but everything behind it.
"""

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
    # Blender may crash while it tidies up: what counts has happened.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
