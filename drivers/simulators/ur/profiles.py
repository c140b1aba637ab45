"""Controller generations that the simulator can be, and what differs between them."""

from __future__ import annotations

from dataclasses import dataclass

Version = tuple[int, ...]


@dataclass(frozen=True)
class Profile:
    """One controller software.

    Attributes:
        key: how the command line and a cell file name it.
        version: major, minor, bugfix, build.
        base_hz: control cycles per second.
        date: of the release, as the dashboard prints it.
        has_dashboard: whether port 29999 exists at all.
    """

    key: str
    version: tuple[int, int, int, int]
    base_hz: int = 500
    date: str = "Aug 31 2022"
    has_dashboard: bool = True

    @property
    def major(self) -> int:
        """3 for CB3, 5 for e-Series, 10 for PolyScope X."""
        return self.version[0]

    @property
    def has_remote_mode(self) -> bool:
        """Whether the controller distinguishes local from remote control."""
        return self.version >= (5, 6)

    @property
    def polyscope(self) -> str:
        """The dashboard's answer to ``PolyscopeVersion``."""
        dotted = ".".join(str(n) for n in self.version)
        return f"URSoftware {dotted} ({self.date})"

    def since(self, cb3: Version | None, e_series: Version) -> bool:
        """Whether something exists here that came with these versions.

        Args:
            cb3: version of the older generation; None when it never got it.
            e_series: version of the newer one; later generations have it.
        """
        if self.major < 5:
            return cb3 is not None and self.version >= cb3
        return self.version >= e_series


PROFILES: dict[str, Profile] = {
    "3.15": Profile("3.15", (3, 15, 8, 106339), base_hz=125, date="Jun 10 2021"),
    "e5.12": Profile("e5.12", (5, 12, 0, 1101319)),
    "e5.21": Profile("e5.21", (5, 21, 0, 1211139), date="Jan 14 2025"),
    "e5.23": Profile("e5.23", (5, 23, 0, 1250012), date="Sep 02 2025"),
    "x10.11": Profile(
        "x10.11", (10, 11, 0, 103), date="Sep 30 2025", has_dashboard=False
    ),
}
DEFAULT_PROFILE = "e5.12"


def model_number(arm: str) -> str:
    """``get robot model`` of an arm called as in ``mvp.kinematics``: UR5 for ur5e."""
    return arm.upper().removesuffix("E")
