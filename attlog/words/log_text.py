"""Find the words that a log's writer chose within sentences, to mark them for programs or to make them public.

A status text, a parameter or a topic is written by whoever had the vehicle, its companion computer or the file. A
language model must take it for data, and a forum must not get the position, name or serial number in it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from attlog.words.text import clean

# Marks around the words of a log; removed from these words themselves.
OPEN, CLOSE = "\u27e6", "\u27e7"
# So many words in a row that a text of the log has too are taken for its words; a shorter text only whole.
RUN = 3
# A text of fewer words and letters says nothing.
MIN_LETTERS = 8
# Letters kept of a name or text that is shown by itself.
MAX_LETTERS = 120
WORD = re.compile(r"\w+")


class LogText:
    """Texts of a log, found again in sentences by runs of words, whatever is between these."""

    def __init__(self, texts: Iterable[str]) -> None:
        self._runs: set[tuple[str, ...]] = set()
        for text in dict.fromkeys(texts):
            words = [word.casefold() for word in WORD.findall(text)]
            if len(words) >= RUN:
                self._runs.update(tuple(words[k : k + RUN]) for k in range(len(words) - RUN + 1))
            elif sum(map(len, words)) >= MIN_LETTERS:
                self._runs.add(tuple(words))

    def replaced(self, sentence: str, change: Callable[[str], str]) -> str:
        """Return a sentence with ``change`` applied to the parts that are the log's words."""
        parts, end = [], 0
        for begin, stop in self._spans(sentence):
            parts += [sentence[end:begin], change(sentence[begin:stop])]
            end = stop
        return "".join([*parts, sentence[end:]])

    def _spans(self, sentence: str) -> Iterator[tuple[int, int]]:
        found = list(WORD.finditer(sentence))
        words = [match[0].casefold() for match in found]
        own = [False] * len(words)
        for size in range(1, RUN + 1):
            for k in range(len(words) - size + 1):
                if tuple(words[k : k + size]) in self._runs:
                    own[k : k + size] = [True] * size
        k = 0
        while k < len(words):
            first = k
            while k < len(words) and own[k]:
                k += 1
            if k > first:
                yield found[first].start(), found[k - 1].end()
            k += 1

    def marked(self, value: Any) -> Any:
        """Return a JSON value whose texts are clean, the log's words in them between marks."""
        if isinstance(value, str):
            return value if is_marked(value) else self._marked(value)
        if isinstance(value, dict):
            return {key: self.marked(item) for key, item in value.items()}
        return [self.marked(item) for item in value] if isinstance(value, list) else value

    def _marked(self, sentence: str) -> str:
        def mark(words: str) -> str:
            return f"{OPEN}{without_marks(words)}{CLOSE}" if words else ""

        return quotes_replaced(self.replaced(_plain(sentence), mark), mark)


# What attlog quotes of a log.
QUOTE = re.compile(r"(?<=“)[^“”]*(?=”)")
QUOTED_EVIDENCE = re.compile(r"^((?:text|report) at \S+ s: )(.*)$")


def quotes_replaced(sentence: str, change: Callable[[str], str]) -> str:
    """Return a sentence with ``change`` applied to what it quotes."""
    sentence = QUOTE.sub(lambda quote: change(quote[0]), sentence)
    return QUOTED_EVIDENCE.sub(lambda line: line[1] + change(line[2]), sentence)


def marked(text: object, letters: int = MAX_LETTERS) -> str:
    """Return a name or text of a log in one line between marks, shortened; an empty one stays empty."""
    words = _plain(" ".join(str(text).split()))
    return f"{OPEN}{words if len(words) <= letters else words[: letters - 3] + '...'}{CLOSE}" if words else ""


def is_marked(text: str) -> bool:
    """Return whether a text is one of :func:`marked`, whole: a log's own words may begin with a mark."""
    return text.startswith(OPEN) and text.endswith(CLOSE) and without_marks(text) == text[1:-1]


def without_marks(text: str) -> str:
    """Return a text without the marks of :func:`marked`."""
    return text.replace(OPEN, "").replace(CLOSE, "")


def _plain(text: str) -> str:
    return without_marks(clean(text).replace("\n", " "))


# Words that firmware writes, collected from the status texts of ArduPilot and PX4.
FIRMWARE_WORDS = frozenset(
    """
    a aborted aborting above acc accel accelerometer accepted accz ack acro action activated active adc advised
    after ahrs aided aiding air airborne airframe airspeed alarm aligned alignment all allowed alt altctl altitude
    an and angerr angle anomaly apm approach approaching arducopter ardupilot arduplane ardurover ardusub are arm
    armable armed arming as at att attitude auto autonomous autorotate autotune aux available avionics avoid bad
    bandwidth baro barometer barometers barometric bat batt battery baud be beginning below beta bias bitrate blind
    blocked blox board boot both bottle boundary brake breach breached bus by bytes calib calibrate calibrated
    calibrating calibration can cannot cell cells change changed channel channels check checks checksum chibios chk
    circle clear cleared climb climbing clipping cmd code cold command commander commands compass compasses
    compensation complete completed connected connection continue continuing control controllers copter core
    corrected correctly count crash crashed critical current cutoff cycle damaged dangerous data dataman db dcm
    deactivate deactivated default deg degrees denied descend descending destination detected dev differ differing
    differs disabled disarm disarmed disarming disconnected distance do done down drift driver dronecan drop due ekf
    elevation emergency enable enabled encoders ended engaged engine enough entered entering err error errors esc
    escs estimate estimator event exceed exceeded exceeds excessive executing expired ext external fail failed
    failing failsafe failsafes failure fallback fast fatal fault fence field file filter finished firmware first fix
    flash flight flip flow flowhold fly flying fmu fmuv follow for forced found fpv frame free freefall frequency
    from frozen fs full fusion gcs gear geofence gesture glitch glitching gnss good gps ground guided guided_nogps
    gyro gyros gyroscope hardware has hdop heading health healthy heartbeat height hexa high hit hold home
    horizontal hot hover hw i2c id ignored imbalance imbalanced immediately imminent imu imus in inconsistent index
    init initial initialised initialising initialized inner inputs ins instance interference internal invalid ip is
    isb jammed jamming kb khz kill killed land landed landing lane large launch leaving leds left level lidar limit
    link load loaded location log logger logging logs loiter loitering long loss lost low lua mag magnetometer main
    manual manually mav mavlink max memory message meters mhz microsd min minimum mismatch missing mission mocap
    mode modes module mon monitor motor motorestop motors mount move ms mygcs name nav navigation navigator need
    needed needs neutral new no node none normal not notify now nsh nuttx obstacle octa of off offboard offset
    offsets ok on only open opened optical or order origin out outputs over overcurrent overflow overheat
    overheating overload parachute param parameter parameters partner pause pilot pitch pixhawk plan plane please
    plus pos posctl position possible potential power ppm prearm preflight pressure primary probing processor
    propeller protocol pwm px quad quadplane quality radio rally ram range rangefinder rate rates rc rcin rcout re
    reached reading ready reboot rebooting received recommended recovered recovery reference refused regained
    rejected relay remaining request requested required requires reset restored return returned returning reversed
    reverting rfnd roll rolled rom rot rotor rover rtk rtl rtt runaway running safe safety sampling satellites sats
    saturated saturation sbus scale script sd sec seconds selector sender sens sensor sensors seq servo set setpoint
    setpoints setting settings settling setup short sim simple sitl size slow small smartrtl sonar soon space
    specified speed spi spin spinning spoofed spoofing sport stabilise stabilize stable stack stale start started
    starting startup state station stationary status stick sticks still stop stopped stopping streaming stuck sub
    successfully sw switch switched switching system tail takeoff target telem telemetry temperature terminated
    terminating termination terrain test tests throttle throw thrown thrust tilt tilted time timeout timesync tkoff
    to tone too took total transition trigger triggered tune type uavcan ulg unaided undervoltage unhealthy unknown
    unstable up update updated usage use used using value variance vectored vehicle velocity verify version vertical
    very vibration vio vision volt voltage vtol wait waiting warming warning waypoint waypoints while wind with
    without wp wq wrong xaccel yaw zero zigzag zone
    """.split()
)
# Longest run of digits that is no serial number, position or time.
MAX_DIGITS = 4
# Whatever its source: places, addresses, dates, times of day, coordinates, serial numbers.
PRIVATE = re.compile(
    r"""(?xi)
    \b[a-z][a-z0-9+.-]*://\S+            # URL
    | [\w.+-]+@[\w-]+(?:\.[\w-]+)+       # mail
    | (?<![\w.])(?:~|[a-z]:)?(?:[/\\][\w.%+-]+){2,}[/\\]?  # path
    | \b\d{4}-\d\d-\d\d(?:[T ]\d\d:\d\d(?::\d\d)?)?\b | \b\d{1,2}[./]\d{1,2}[./]\d{4}\b  # date
    | \b\d{1,2}:\d\d(?::\d\d(?:\.\d+)?)?\b  # time of day
    | \b\d{1,3}(?:\.\d{1,3}){3}\b        # network address
    | [-+\u2212]?\b\d{1,3}\.\d{5,}       # degrees of a position
    | \b(?=[0-9a-f]*\d)[0-9a-f]{8,}\b    # serial number
    | (?<=the\ model\ says\ )[-+\u2212]?[\d.]+(?=\ ?(?:°|deg)) | (?<=declination\ of\ )[-+\u2212]?[\d.]+
    | (?:(?<=_DEC\ says\ )|(?<=_DECL\ says\ )|(?<=_DECL_A\ says\ ))[-+\u2212]?[\d.]+  # declination of a place
    """
)
LEFT_OUT = "…"
# A number with decimals beside what was left out.
DECIMALS = r"[-+\u2212]?\d+\.\d+°?[NSEW]?[,;:]?(?!\S)"
BESIDE = re.compile(rf"{LEFT_OUT}\s+{DECIMALS}|(?<!\S){DECIMALS}\s+{LEFT_OUT}")
# A telephone number, or a serial number in groups.
NUMBERS = re.compile(r"(?<!\S)(?:(?=[^\s]*\d)[0-9A-Fa-f.,:()/+-]+\s+)+(?=[^\s]*\d)[0-9A-Fa-f.,:()/+-]+(?!\S)")
# A time of :func:`attlog.words.numbers.moment`, which reads like a time of day.
CLOCK = re.compile(r"\b(\d+):(\d\d):(\d\d)\b")


def public(sentence: str, texts: LogText) -> str:
    """Return a sentence for the public: of the log's words only those of firmware, without places, names and times."""
    sentence = texts.replaced(_plain(sentence), firmware_words)
    sentence = quotes_replaced(sentence, firmware_words)
    sentence = CLOCK.sub(lambda m: f"{3600 * int(m[1]) + 60 * int(m[2]) + int(m[3])} s", sentence)
    return PRIVATE.sub(LEFT_OUT, sentence)


def firmware_words(words: str) -> str:
    """Return words of a log with an ellipsis for those that firmware does not write, as names are."""
    kept = NUMBERS.sub(lambda run: LEFT_OUT if len(re.findall(r"\d", run[0])) > MAX_DIGITS else run[0], words)
    kept = re.sub(r"\S+", lambda word: word[0] if _is_firmware(word[0]) else LEFT_OUT, kept)
    while kept != (shorter := BESIDE.sub(LEFT_OUT, kept)):  # what an unknown word says of a number may be a place
        kept = shorter
    return re.sub(rf"{LEFT_OUT}(\s+{LEFT_OUT})+", LEFT_OUT, kept)


def _is_firmware(word: str) -> bool:
    if re.search(r"[/\\@<>`*\[\]|]|\d:\d\d", word) or len(re.findall(r"\d", word)) > MAX_DIGITS:
        return False
    parts = re.findall(r"[^\W\d_]+", word)
    few = len(parts) == 1 and len(re.findall(r"\d", word)) <= 2
    return all(part.casefold() in FIRMWARE_WORDS or (len(part) == 1 and few) for part in parts)
