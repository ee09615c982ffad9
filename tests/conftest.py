"""Linear algebra on one thread, here and in every process that a test starts.

The matrices are small: threads that wait for one another take many times as long as one alone as
soon as the machine has other work.
"""

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
