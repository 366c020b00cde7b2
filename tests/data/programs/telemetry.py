"""Read the newest recording: speeds as a DataFrame, and the nearest echo of each scan."""

import sidestep
from sidestep import Recording, SonarScan, Table


def nearest_m(recording: Recording) -> list[float]:
    found: list[float] = []
    for _, message in recording.messages("sonar"):
        if isinstance(message, SonarScan):
            found.append(min(one for one in message.ranges_m if one is not None))
    return found


def main() -> None:
    recording = sidestep.open_recording()
    odometry: Table = recording["odometry"]
    print(recording.robot, recording.duration_s, len(odometry), odometry["speed_m_s"][:5])
    frame = odometry.to_pandas()
    print(frame.describe())
    print(nearest_m(recording)[:5])


if __name__ == "__main__":
    main()
