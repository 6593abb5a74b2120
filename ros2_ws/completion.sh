# SPDX-License-Identifier: Apache-2.0
# Completes `python -m atpid_... ` with TAB in bash and zsh; `. ros2_ws/activate` reads it in an interactive shell.
# The functions are made from the commands' parsers at the first TAB, and again where the sources are newer.

_ATPID_COMPLETION_ROOT=$_atpid_root
_ATPID_PROGRAMS="atpid_control atpid_driver atpid_sim atpid_control.recording"

# _atpid_load SHELL: read the functions once.
_atpid_load() {
    [ -z "${_ATPID_COMPLETION_READ:-}" ] || return 0
    local root=$_ATPID_COMPLETION_ROOT
    local made=$root/.venv/share/atpid/completion.$1
    if [ ! -s "$made" ] || [ -n "$(find "$root"/atpid_*/atpid_* -name '*.py' -newer "$made" -print -quit)" ] ||
        [ -n "$(find "$root"/.venv/lib/python3.*/site-packages -maxdepth 0 -newer "$made")" ]; then
        # eval: zsh does not split a variable into words
        eval "'$root/.venv/bin/python' -m atpid_common.completion $1 $_ATPID_PROGRAMS --out '$made'" \
            < /dev/null > /dev/null 2>&1 || return 1
    fi
    eval "$(cat "$made")" && _ATPID_COMPLETION_READ=1
}

if [ -n "${BASH_VERSION:-}" ]; then
    _atpid_python() {
        COMPREPLY=()
        [ "${COMP_WORDS[1]}" = -m ] || return 0
        local word=${COMP_WORDS[COMP_CWORD]} program=${COMP_WORDS[2]}
        if [ "$COMP_CWORD" -eq 2 ]; then
            COMPREPLY=($(compgen -W "$_ATPID_PROGRAMS" -- "$word"))
            return 0
        fi
        case " $_ATPID_PROGRAMS " in *" $program "*) ;; *) return 0 ;; esac
        _atpid_load bash || return 0
        local words=("${COMP_WORDS[@]}") place=$COMP_CWORD
        COMP_WORDS=("${words[@]:2}")
        COMP_CWORD=$((place - 2))
        "_shtab_${program//./_}"
        COMP_WORDS=("${words[@]}")
        COMP_CWORD=$place
    }
    complete -o bashdefault -o default -F _atpid_python python python3
elif [ -n "${ZSH_VERSION:-}" ] && typeset -f compdef > /dev/null; then
    _atpid_python() {
        if [[ ${words[2]} == -m && $CURRENT -eq 3 ]]; then
            compadd -- ${=_ATPID_PROGRAMS}
        elif [[ ${words[2]} == -m && " $_ATPID_PROGRAMS " == *" ${words[3]} "* ]] && _atpid_load zsh; then
            local program=${words[3]//./_}
            shift 2 words
            ((CURRENT -= 2))
            "_shtab_$program"
        elif typeset -f _python > /dev/null || autoload -Uz +X _python 2> /dev/null; then
            _python "$@"
        else
            _default
        fi
    }
    compdef _atpid_python python python3
fi
