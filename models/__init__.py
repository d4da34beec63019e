"""What turns images into phases and points; knows nothing of hardware or service."""

import os

# torch and numba bring an OpenMP runtime each. Idle threads of one must sleep, not spin, while the other works.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
