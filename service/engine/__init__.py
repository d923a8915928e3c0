"""The only place that knows the queue engine (DBOS Transact).

A job is a durable workflow on the queue ``project``, which holds no processor: it asks the job's plan for the next
stage and puts each step of it on the queue ``compute`` as a workflow of its own. A step runs in a child process. What
finished is recorded and never repeated; what a dead worker left is taken up by another. A database that is away is
waited for.
"""

from service.engine.execution import Engine
from service.engine.queue import DbosQueue, prepare
from service.engine.tools import Tools

__all__ = ["DbosQueue", "Engine", "Tools", "prepare"]
