"""The commands of `edge-service`, by topic: each reads its arguments and calls a room.

Linear algebra runs on one thread unless the environment says otherwise, here and in every process
that a command starts. The matrices are small: threads that wait for one another take several times
as long as one alone as soon as the machine has other work.
"""

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # read once, when numpy is loaded: below this line
