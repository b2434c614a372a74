"""What `import rsvideo` offers: photographs and clips as arrays, restored by the same rooms as the command.

Each public name is loaded when it is first used, so that `import rsvideo` costs next to nothing.
"""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # compiled loops whose threads spin while they wait starve others; read once
