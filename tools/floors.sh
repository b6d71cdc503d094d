#!/bin/sh
# Checks who includes whom, and prints the lines that must not be: a folder includes only folders and
# public headers on floors below it, or its own (src/README.md); a library that one part wraps is
# known to that part alone; that no type's name is taken twice; that no function is too long or has too
# many paths; that the public headers say of every function what it does.
# `tools/floors.sh [DIR]` checks another tree.
set -eu
cd "${1:-$(dirname "$0")/..}"
bad=0

complain() { # TITLE LINES
    [ -n "$2" ] || return 0
    printf '%s\n%s\n' "$1" "$2" >&2
    bad=1
}

# Include lines of these files and folders that match, but for files that match EXCEPT.
includes() { # PATTERN EXCEPT PATH...
    pattern=$1 except=$2
    shift 2
    grep -rnE "^[[:space:]]*#[[:space:]]*include[[:space:]]*$pattern" "$@" 2>/dev/null |
        grep -vE "^($except):" || true
}

floor() {
    case $1 in
    base) echo 1 ;;
    model) echo 2 ;;
    sim | ctrl) echo 3 ;;
    driver | ident | exchange | experiment) echo 4 ;;
    explain) echo 5 ;;
    investigate) echo 6 ;;
    console) echo 7 ;;
    esac
}
folders="base model sim ctrl driver ident exchange experiment explain investigate console"

# Public headers stand on the floor of the folder that implements them. The board interface is on
# the loop's floor: the loop is given a board and does not know which.
header_floor() {
    case $1 in
    status | number | ring | log | json | clock) echo 1 ;;
    model) echo 2 ;;
    ident | signals | excite | measure | exchange | data_check) echo 4 ;;
    explain) echo 5 ;;
    *) echo 3 ;;
    esac
}

for folder in $folders; do
    [ -d "src/$folder" ] || continue
    for other in $folders; do
        [ "$other" != "$folder" ] && [ "$(floor "$other")" -ge "$(floor "$folder")" ] || continue
        complain "src/$folder must not include src/$other:" \
            "$(includes "\"([.][.]/)*$other/" 'none' "src/$folder")"
    done
done

for path in include/mechkit/*.h; do
    header=$(basename "$path" .h)
    on=$(header_floor "$header")
    for folder in $folders; do
        [ -d "src/$folder" ] && [ "$(floor "$folder")" -lt "$on" ] || continue
        complain "src/$folder must not include mechkit/$header.h:" \
            "$(includes "[\"<]mechkit/$header[.]h" 'none' "src/$folder")"
    done
    for user in include/mechkit/*.h; do
        [ "$(header_floor "$(basename "$user" .h)")" -lt "$on" ] || continue
        complain "$user must not include mechkit/$header.h:" \
            "$(includes "[\"<]mechkit/$header[.]h" 'none' "$user" /dev/null)"
    done
done
complain "public headers include public headers only:" \
    "$(includes '"' 'none' include | grep -v '"mechkit/' || true)"

sundials='(arkode|cvodes?|idas?|kinsol|nvector|sundials|sunlinsol|sunmatrix|sunnonlinsol)/'
complain "only src/sim/sundials.cpp includes SUNDIALS:" \
    "$(includes "<$sundials" 'src/sim/sundials[a-z_]*[.](c|cpp|hpp|h)' src include tests)"
complain "cJSON comes with mechkit/json.h:" \
    "$(includes '[<"](cjson/)?cJSON' 'include/mechkit/json[.]h|src/base/json[.]c' src include tests)"
complain "Eigen stays in C++ sources:" \
    "$(includes '<(unsupported/)?Eigen' '(src|tests)/[a-z_/]+[.](cpp|hpp|cc)' src include tests)"
complain "only the screen (src/console/screen/tui_term.c) includes curses:" \
    "$(includes '<(n?cursesw?/)?(n?curses|panel|form|menu|term)[.]h' 'src/console/screen/tui_term[.]c' src include)"
complain "zlib stays in src/base:" "$(includes '<zlib' 'src/base/[a-z_]+[.][ch]' src include)"
complain "matio stays in src/exchange:" \
    "$(includes '<matio' 'src/exchange/[a-z_]+[.][ch]' src include)"
complain "libusb stays in src/driver:" "$(includes '<libusb' 'src/driver/[a-z_]+[.][ch]' src include)"
complain "inih stays in src/base/ini_file.c:" \
    "$(includes '<ini[.]h' 'src/base/ini_file[.]c' src include)"

# A plant is one file: what others need to know of it stands in its row. A set-up's file says in its
# own row which plant it is for (MK_CTRL_PLANT).
complain "only the plants' own files (src/model/plant_*.hpp) name a plant:" \
    "$(grep -rnE 'MK_PLANT_[A-Z]' src | grep -vE '^src/model/plants?([.]|_[a-z_]+[.])(h|hpp|cpp):' |
        grep -v 'MK_PLANT_COUNT' || true)"

# A function is read without turning a page, and its paths are few enough to be tested. Sources are
# formatted: a function's braces stand alone, on lines that are indented alike.
#
# Its complexity is McCabe's (1976), modified: 1, and 1 for every if, loop, catch, switch, ?:, && and
# ||. A switch counts once however many cases it has: a table is no harder to read for being long.
longest=80 complexity=15
measured=$(find src -name '*.[ch]' -o -name '*.cpp' -o -name '*.hpp' -o -name '*.cc' | sort |
    xargs awk '
        # Code of a line: texts, comments and the preprocessor taken out.
        function code_of(line, head, tail) {
            gsub(/\\./, "", line)
            gsub(/"[^"]*"|\047[^\047]*\047/, "", line)
            if (in_comment) {
                if (!match(line, /[*]\//))
                    return ""
                line = substr(line, RSTART + 2)
                in_comment = 0
            }
            sub(/\/\/.*/, "", line)
            while (match(line, /\/[*]/)) {
                head = substr(line, 1, RSTART - 1)
                tail = substr(line, RSTART + 2)
                in_comment = !match(tail, /[*]\//)
                line = in_comment ? head : head " " substr(tail, RSTART + 2)
                if (in_comment)
                    break
            }
            return line ~ /^ *#/ ? "" : line
        }
        function branches(code, n, word, i, count) {
            count = gsub(/&&|[|][|]|[?]/, " ", code)
            n = split(code, word, /[^A-Za-z0-9_]+/)
            for (i = 1; i <= n; i++)
                count += word[i] ~ /^(if|for|while|switch|catch)$/
            return count
        }
        FNR == 1 { close_at = before = ""; in_comment = 0 }
        { code = code_of($0) }
        close_at == "" && /^ *(try )?[{]$/ && before ~ /[)]( const| noexcept| override| final)*$/ {
            match($0, /^ */)
            close_at = substr($0, 1, RLENGTH) "}"
            from = FNR
            paths = 1
        }
        close_at != "" { paths += branches(code) }
        close_at != "" && $0 == close_at {
            print FILENAME, from, FNR - from, paths
            close_at = ""
        }
        /[^ ]/ { before = $0 }')
complain "a function has $longest lines at most:" "$(printf '%s\n' "$measured" |
    awk -v most="$longest" '$3 > most { printf "%s:%d: %d lines\n", $1, $2, $3 }')"
complain "a function has a complexity of $complexity at most:" "$(printf '%s\n' "$measured" |
    awk -v most="$complexity" '$4 > most { printf "%s:%d: %d\n", $1, $2, $4 }')"

# Whoever calls the library has its headers only: a comment above each function, or behind it, says
# what it does, with units, ranges, errors and who owns what.
map=src/libmechkit.map
[ ! -f $map ] || complain "a function that the library exports has a comment in its header:" \
    "$(awk -v map=$map '
        FNR == 1 { commented = inside = behind = 0; text = "" }
        FILENAME == map {
            if ($1 ~ /^mk_[a-z0-9_]*;$/)
                exported[substr($1, 1, length($1) - 1)] = 1
            next
        }
        behind { behind = !/[*]\//; next } # the rest of a comment that stands behind a declaration
        inside || (text == "" && /^ *\/[*]/) {
            inside = !/[*]\//
            commented = !inside
            next
        }
        /^#/ || /^ *$/ { commented = 0; next }
        {
            if (text == "") {
                told = commented
                from = FNR
            }
            if (/;.*\/[*]/) {
                told = 1
                behind = !/[*]\//
            }
            code = $0
            sub(/\/[*].*/, "", code)
            text = text code
            if (code !~ /[;{}] *$/)
                next
            if (match(text, /mk_[a-z0-9_]*\(/)) {
                name = substr(text, RSTART, RLENGTH - 1)
                if (exported[name] && !told)
                    printf "%s:%d: %s\n", FILENAME, from, name
            }
            text = ""
            commented = 0
        }' $map include/mechkit/*.h)"

# Two of one name in one namespace share the code of the templates that are made of them.
types='^(struct|class) [A-Z][A-Za-z0-9]*( final)?( : .*)?( [{])?$'
for name in $(grep -rhE "$types" --include='*.hpp' src | awk '{ print $2 }' | sort | uniq -d); do
    complain "a type's name stands in one header:" \
        "$(grep -rnE "$types" --include='*.hpp' src | grep -E ":(struct|class) $name( |\$)")"
done
exit $bad
