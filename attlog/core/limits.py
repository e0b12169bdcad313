"""Upper limits on what a log, a file or a plug-in may ask for, each with its reason.

Logs come from crashes and from strangers, so sizes and counts found in a file are never trusted. A limit that is hit
becomes a problem in the list, never an exception that hides the rest of the log.
"""

from __future__ import annotations

# Formats and fields.

# Message formats per log. Real firmware defines under 300; ULog ids are u16.
MAX_FORMATS = 4096
# Flattened fields per message. The largest real topics (fifo, esc) have a few hundred.
MAX_FIELDS = 4096
# Depth of nested ULog types. Real logs use 2; a cycle in the definitions must end.
MAX_NESTING = 8
# Flattened fields per log, each layout once. Real logs have under 10,000. A kilobyte of nested definitions can ask for
# millions, at 200 bytes each.
MAX_COLUMNS = 50_000
# Formats redefined with other members. Each redefinition discards what was derived from formats; real logs have none.
MAX_REDEFINED = 16
# Changes of the topic of a ULog id. Each change sorts the records read so far; real logs have none.
MAX_RESUBSCRIBED = 4096
# Layouts of one topic in one file. Columns are joined from as many parts; two logs in one file have two.
MAX_LAYOUTS = 64
# Positions of the time stamp that are tried for records without subscription.
MAX_GUESSES = 16
# ULog ids without definition whose records are followed by size alone. Real logs subscribe to some 200 topics, and
# following an id sorts the records read so far once.
MAX_IDS_FOLLOWED = 512
# Different definitions of one DataFlash message. Each firmware in joined logs brings one.
MAX_LAYOUTS_OF_A_NAME = 16
# Sensors or cores numbered by one column: the values of a byte. A column with more numbers is no instance.
MAX_INSTANCES = 256
# Systems and components in a MAVLink capture. Swarms of hundreds fit; random headers give 65536.
MAX_SENDERS = 1024

# DataFlash text logs: the binary format, from which texts are made, is narrower.

# Columns of one message; 16 in the binary format.
MAX_LETTERS = 32
# Messages of one log; binary records number their types in a byte.
MAX_TEXT_FORMATS = 256
# Letters of a message's or column's name; 4 and 64 (all columns together) in the binary format.
MAX_NAME_LENGTH = 64
# Bytes of one value. Texts have 64 bytes, the longest float32 prints with 56.
MAX_CELL_BYTES = 512

# Contents beside the data.

# Information entries of a log (versions, hardware). Real logs have about 40, at 400 bytes of memory each.
MAX_INFO = 10_000
# Dropouts reported by a logger. More than a hundred a second leave nothing else in the log.
MAX_DROPOUTS = 100_000
# Log messages kept, so that a log which repeats one warning for hours stays readable.
MAX_TEXTS = 100_000
# Letters kept of a log message or info value. Crash dumps are longer and of no use here.
MAX_TEXT_LENGTH = 4096
# Parameter records kept, at 200 bytes of memory each: a table of 1,500 repeated 130 times.
MAX_PARAM_CHANGES = 200_000
# Damaged places listed one by one; further ones are counted.
MAX_DAMAGE = 1000
# Attitudes that become rows, each compared, drawn and listed. Ten EKF cores, cameras and simulators are below 16.
MAX_ATTITUDES = 24
# Power-ups distinguished in one file of joined logs; the rest belongs to the last.
MAX_BOOTS = 100

# Values.

# Autopilots without a real clock count from 0, others end in 2100. Random bytes are hardly ever below.
LAST_TIME_US = 4_102_444_800_000_000
# A record this far from its neighbours in time is false; no flight pauses so long.
MAX_TIME_JUMP_S = 3600.0 * 12
# MEMS gyros measure up to 4000 deg/s = 70 rad/s; larger values are damage.
GYRO_LIMIT_RAD_S = 100.0
# Accelerometers of autopilots measure up to 200 g; larger values are damage.
ACC_LIMIT_M_S2 = 2000.0
# The earth's field is below 70 uT; 5 mT includes magnets and excludes damage.
MAG_LIMIT_T = 5e-3

# Files.

# Logs up to this size (some five minutes of a ULog at full rate) are read into memory; larger ones are mapped where
# MAPPED is set. Pages of a mapped log are dropped where memory is short, so its bytes do not add to that of filters.
READ_BYTES = 32 << 20
# The same for a command that names several logs: a mapped log that is cut ends the command for all of them.
READ_OF_SEVERAL_BYTES = 256 << 20
# Size of records above which decoded columns are released after each part of a flight is read, and decoded again where
# another part needs them. They can take gigabytes: 120 of 750 MB for a log of 143 MB. For 60 MB it is 20 to 60 MB, and
# decoding again would cost info of a .bin a third of its time.
RELEASED_BYTES = 128 << 20
# Size above which a file that is no log, such as a disk image, is refused before its bytes are hashed.
NO_LOG_BYTES = 256 << 20
# Environment variable that allows mapping. Truncation of a mapped file kills the process, so attlog's commands set it
# only for supervised processes.
MAPPED = "ATTLOG_MAPPED"
# Unpacked size of a gzip file: autopilots log to FAT cards, whose files end at 4 GiB.
MAX_UNPACKED_BYTES = 4 << 30
# Unpacked bytes per byte of a gzip file. Logs pack 2 to 20 times, gzip bombs 1000 times.
MAX_UNPACKED_RATIO = 200
# Unpacked size that is allowed at any ratio: dumps of a flash chip that is mostly erased.
UNPACKED_ANYWAY_BYTES = 64 << 20
# Bytes of extracted tables per byte of a log. A number of one byte takes some 20 in a CSV file with its time.
MAX_EXTRACT_RATIO = 100
# Size of extracted tables that is allowed at any ratio: rerun filters write more than the log holds.
EXTRACT_ANYWAY_BYTES = 256 << 20
# Files in one zip archive; more are no folder of flights.
MAX_MEMBERS = 100_000
# Bytes of a file name from a server or archive. File systems end at 255; a number and suffixes are added.
MAX_FILE_NAME_BYTES = 150
# Folders below a URL; links of a web server can form circles.
MAX_LISTING_DEPTH = 12
# Seconds without data after which a download is given up.
STALLED_S = 60.0
# Duration of a download: 4 GiB at 0.6 MB/s.
MAX_FETCH_S = 7200.0
# Files of options, parameters, gates or a scenario. The largest parameter files have 100 kB.
MAX_SETTINGS_BYTES = 8 << 20
# Results and tables that are read back. 20 filters over hours make 20 MB.
MAX_RESULT_BYTES = 1 << 30

# Filters from files, and sweeps.

# Time of one run (ATTLOG_FILTER_TIMEOUT). Plain Python takes some 15 s for ten minutes at 250 Hz.
FILTER_S = 60.0
# Memory of one run. An hour at 1 kHz takes 1 GB with all that is kept of it.
MAX_FILTER_BYTES = 4 << 30
# Letters kept of an exception. Tables, pages and terminals take minutes for ten million.
MAX_ERROR_LETTERS = 500
# Settings of one sweep: minutes on one log, and more than a page can show. A typed grid can have any number.
MAX_SETS = 4096
# Values of one range.
MAX_VALUES = 1000
