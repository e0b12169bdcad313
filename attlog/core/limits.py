"""Upper limits on what a log may ask for, each with its reason.

Logs come from crashes and from strangers: sizes and counts found in a file are
never trusted. A limit that is hit becomes a problem in the list, never an
exception that hides the rest of the log.
"""

from __future__ import annotations

MAX_FORMATS = 4096
"""Message formats per log. Real firmware defines under 300; ULog ids are u16."""

MAX_FIELDS = 4096
"""Flattened fields per message. The largest real topics (fifo, esc) have a few hundred."""

MAX_NESTING = 8
"""Depth of nested ULog types. Real logs use 2; a cycle in the definitions must end."""

MAX_COLUMNS = 50_000
"""Flattened fields per log, each layout once. Real logs have under 10,000; a kilobyte of nested definitions can ask for
millions, at 200 bytes each."""

MAX_REDEFINED = 16
"""Formats that a log may declare anew with other members: everything that was concluded of formats is concluded again
each time. Real logs declare a format once."""

MAX_RESUBSCRIBED = 4096
"""Times that an id of a log may change its meaning: what was read so far is sorted each time. Real logs never do."""

MAX_LAYOUTS = 64
"""Layouts of one topic in one file: columns are put together from as many parts. Two logs in one file have two."""

MAX_GUESSES = 16
"""Places of the time stamp that are tried for records whose subscription is lost."""

MAX_IDS_FOLLOWED = 512
"""Ids of a ULog without a definition whose records are followed by their size alone; more are looked at one by one.
Real logs subscribe to some 200 topics, and each of these ids has what was read so far sorted once."""

MAX_INFO = 10_000
"""Statements of a log about itself. Real ones make about 40, at 400 bytes of memory each."""

MAX_DROPOUTS = 100_000
"""Dropouts that a logger reports; with more than a hundred a second nothing else is left in the log."""

MAX_TEXTS = 100_000
"""Log messages kept. A log that repeats one warning for hours stays readable."""

MAX_TEXT_LENGTH = 4096
"""Characters kept of one log message or info value; crash dumps are longer and useless here."""

MAX_PARAM_CHANGES = 200_000
"""Parameter records kept, at 200 bytes of memory each: a table of 1,500 repeated 130 times."""

MAX_DAMAGE = 1000
"""Damaged places kept one by one; beyond that only their count and bytes grow."""

MAX_LETTERS = 32
"""Columns of one message in a DataFlash text log; the binary format, from which texts are made, has room for 16."""

MAX_TEXT_FORMATS = 256
"""Messages of one DataFlash text log: binary records number their types in a byte."""

MAX_NAME_LENGTH = 64
"""Characters of a message's or column's name in a text log; binary ones have room for 4 and for 64 with all others."""

MAX_CELL_BYTES = 512
"""Of one value in a text log: texts have 64 bytes, and the longest float32 prints with 56."""

MAX_LAYOUTS_OF_A_NAME = 16
"""Definitions of one DataFlash message that differ: each firmware in joined logs brings one, and a column of each."""

MAX_INSTANCES = 256
"""Numbers of sensors or cores in one column, which is what one byte can tell; more number something else."""

MAX_SENDERS = 1024
"""Systems and components in one capture of MAVLink: swarms of hundreds fit, made-up headers give 65536."""

MAX_ATTITUDES = 24
"""Attitudes of one log that become rows: ten EKF cores with what cameras and simulators tell are below 16; each is
compared, drawn and listed."""

MAX_BOOTS = 100
"""Power-ups distinguished in one file of joined logs; what is behind belongs to the last."""

LAST_TIME_US = 4_102_444_800_000_000
"""Autopilots without a real clock count from 0, others end in 2100; random bytes are hardly ever below."""

READ_BYTES = 256 << 20
"""Logs up to this size (some hours at full rate) are always read into memory; larger ones are memory-mapped where
:data:`MAPPED` is set."""

MAPPED = "ATTLOG_MAPPED"
"""The environment variable by which a process takes the risk of mapping: where a mapped file is cut, the system ends
it. attlog's commands set it for processes that another one watches."""

MAX_UNPACKED_BYTES = 4 << 30
"""What a gzip file may hold: autopilots log to FAT cards, whose files end at 4 GiB."""

MAX_UNPACKED_RATIO = 200
"""Bytes that a byte of a gzip file may stand for: logs pack 2 to 20 times, gzip bombs 1000 times."""

UNPACKED_ANYWAY_BYTES = 64 << 20
"""Never too much to unpack, whatever the ratio: dumps of a flash chip that is mostly erased."""

MAX_EXTRACT_RATIO = 100
"""Bytes of tables that a byte of a log may become: a number of one byte takes some 20 in a CSV file with its time."""

EXTRACT_ANYWAY_BYTES = 256 << 20
"""Never too much to write, whatever the ratio: rerun filters say more than the log does."""

MAX_MEMBERS = 100_000
"""Files in one zip archive; a directory of more is no folder of flights."""

MAX_FILE_NAME_BYTES = 150
"""Kept of a name that a server or an archive gives; file systems end at 255, and a number and suffixes are added."""

MAX_LISTING_DEPTH = 12
"""Folders below a URL; a web server's links can lead in circles."""

STALLED_S = 60.0
"""A download is given up when nothing came for so long."""

MAX_FETCH_S = 7200.0
"""A download is given up after this time: 4 GiB at 0.6 MB/s."""

MAX_TIME_JUMP_S = 3600.0 * 12
"""A record this far from its neighbours in time is a false record, not a flight."""

GYRO_LIMIT_RAD_S = 100.0
"""No MEMS gyro measures beyond 4000 deg/s = 70 rad/s; larger values are damage."""

ACC_LIMIT_M_S2 = 2000.0
"""No accelerometer of an autopilot measures beyond 200 g; larger values are damage."""

MAG_LIMIT_T = 5e-3
"""The earth's field is below 70 uT; 5 mT leaves room for magnets and excludes damage."""

FILTER_S = 60.0
"""A filter from a file may take so long for one run (``ATTLOG_FILTER_TIMEOUT``): in plain Python it takes some 15 s for
ten minutes at 250 Hz, compiled it takes none to speak of."""

MAX_FILTER_BYTES = 4 << 30
"""What a filter from a file may take of memory; an hour at 1 kHz is 1 GB with all that is kept of it."""

MAX_ERROR_LETTERS = 500
"""What an exception of a filter from a file may say: it stands in tables, pages and terminals, which take minutes for
ten million letters."""

MAX_SETS = 4096
"""Settings of one sweep: minutes on one log, and more than a page can show; a grid is typed in a second."""

MAX_VALUES = 1000
"""Values of one range."""

MAX_SETTINGS_BYTES = 8 << 20
"""A file of options, parameters, gates or a scenario; the largest parameter files have 100 kB."""

MAX_RESULT_BYTES = 1 << 30
"""A result or a table that is read back; 20 filters over hours make 20 MB."""
