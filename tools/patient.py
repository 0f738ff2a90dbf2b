"""Executes a notebook without stalling.

nbclient waits for a kernel's reply without a limit while it serves Output widgets, and can so wait for ever
(jupyter/nbclient issue 312). Here every wait on the shell channel is cut into slices of a second.
"""

from queue import Empty
from time import monotonic

from jupyter_core.utils import run_sync
from nbclient import NotebookClient

SLICE_S = 1.0


class PatientClient(NotebookClient):
    """A NotebookClient whose waits on the shell channel come back every second."""

    async def async_start_new_kernel_client(self):
        """The client of a started kernel, its shell channel polled in slices."""
        client = await super().async_start_new_kernel_client()
        get_once = client.shell_channel.get_msg

        async def get_msg(timeout=None):
            end = None if timeout is None else monotonic() + timeout
            while True:
                left = SLICE_S if end is None else min(SLICE_S, max(0.0, end - monotonic()))
                try:
                    return await get_once(timeout=left)
                except Empty:
                    if end is not None and monotonic() >= end:
                        raise

        client.shell_channel.get_msg = get_msg
        return client

    start_new_kernel_client = run_sync(async_start_new_kernel_client)
