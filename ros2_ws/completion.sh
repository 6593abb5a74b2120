# SPDX-License-Identifier: Apache-2.0
# Completes `atpid ...` with TAB in bash and zsh; `. ros2_ws/activate` reads it in an interactive shell.
# The functions are made from the commands' parsers at the first TAB, and again where the sources are newer.

_ATPID_COMPLETION_ROOT=$_atpid_root

# _atpid_load SHELL: read the functions once.
_atpid_load() {
    [ -z "${_ATPID_COMPLETION_READ:-}" ] || return 0
    local root=$_ATPID_COMPLETION_ROOT
    local made=$root/.venv/share/atpid/completion.$1
    if [ ! -s "$made" ] || [ -n "$(find "$root"/atpid_*/ "$root"/extensions/ -name '*.py' -newer "$made" -print -quit)" ] ||
        [ -n "$(find "$root"/.venv/lib/python3.*/site-packages -maxdepth 0 -newer "$made")" ]; then
        atpid completion "$1" --out "$made" < /dev/null > /dev/null 2>&1 || return 1
    fi
    eval "$(cat "$made")" && _ATPID_COMPLETION_READ=1
}

if [ -n "${BASH_VERSION:-}" ]; then
    _atpid_program() {
        COMPREPLY=()
        _atpid_load bash && _shtab_atpid
    }
    complete -o bashdefault -o default -F _atpid_program atpid
elif [ -n "${ZSH_VERSION:-}" ] && typeset -f compdef > /dev/null; then
    _atpid_program() { _atpid_load zsh && _shtab_atpid; }
    compdef _atpid_program atpid
fi
