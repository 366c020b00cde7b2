"""A disk whose pace a test sets, and requests whose answers it sees."""

from protocol.bus.services import ServiceRequest
from protocol.wire.message import Message
from robot.file_writer import Done, Job, do


class HeldWriter:
    """Writes nothing until `finish` is called."""

    def __init__(self) -> None:
        self.waiting: list[Job] = []
        self._done: list[Done] = []

    def submit(self, job: Job) -> None:
        self.waiting.append(job)

    def done(self) -> list[Done]:
        done, self._done = self._done, []
        return done

    def close(self, patience_s: float) -> None:
        """Mark the end of the loop."""
        if patience_s > 0.0:
            self.finish()

    def finish(self, error: OSError | None = None) -> None:
        """Let the jobs there are come to their end: written, or failed with this error."""
        for job in self.waiting:
            self._done.append(do(job) if error is None else Done(job, error))
        self.waiting = []


class Question(ServiceRequest):
    """A request as the bus would hand it on; what is answered is kept."""

    def __init__(self, message: Message | None, operator: str = "ada/1") -> None:
        self.message = message
        self.operator = operator
        self.answers: list[Message | bytes] = []

    def reply(self, answer: Message | bytes) -> bool:
        self.answers.append(answer)
        return True
