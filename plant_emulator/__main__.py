"""`python -m plant_emulator RIG --bus URL`."""

import sys

from plant_emulator.command_line import main

sys.exit(main())
