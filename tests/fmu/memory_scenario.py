"""What test_fmu_memory.py runs under sanitizers or valgrind: everything an importer does, several times over.
python memory_scenario.py BUILD_FOLDER [ROWS]"""

import sys

from fmpy.fmi1 import FMICallException
from fmu_support import ESTIMATOR, MODELS, Instance, recorded_drive, unit


def main(folder: str, rows: int) -> None:
    """Drive, save, restore, refuse, free."""
    for model in MODELS:
        of = unit(model, folder)
        for _ in range(2):
            with Instance(of, "a", logging=True) as a, Instance(of, "b") as b:
                parameters = {"filter.particles": 60} if model == ESTIMATOR else {"simulation.seed": 2}
                a.start(parameters)
                if model == ESTIMATOR:
                    recorded_drive(rows).through_fmu(a)
                else:
                    for k in range(rows):
                        a.set({"wheel_torque_front": 100.0 * (k % 5), "steer_angle": 0.001 * (k % 9)})
                        a.step(0.01 * k, 0.01)
                        a.get()
                data = a.state()
                b.restore(data)
                for bad in (data[:-1], data[:3], data[:100] + b"x" + data[101:], b"\0" * len(data)):
                    try:
                        b.restore(bad)
                    except FMICallException:
                        continue
                    raise AssertionError("a damaged state was taken")
                for call in (lambda i=a: i.slave.getReal([10**6]), lambda i=a: i.set({"vehicle.mass": 1.0})):
                    try:
                        call()
                    except FMICallException:
                        continue
                    raise AssertionError("a wrong call was taken")
                a.slave.terminate()
                a.slave.reset()
        print(model, "done")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 200)
