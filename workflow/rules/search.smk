localrules:
    propose,


checkpoint propose:
    # Scores the guesses of the round before and asks for the next ones, or says stop.
    input:
        before_round,
        settings=ancient(SETTINGS_FILE),
        data=f"{MODEL}/prepared.npz",
        **MESHES,
        templates=layout.template_files(SETTINGS),
    output:
        f"{MODEL}/rounds/{{round}}.json",
    log:
        f"{MODEL}/logs/propose/{{round}}.log",
    params:
        settings=PARTS["propose"],
        last=last_option,
        code=layout.fingerprint("propose"),
    threads: 2
    resources:
        mem_mb=1000,
    shell:
        "fingerfit propose {input.settings} --data {input.data} {MESH_OPTIONS} --sims {STUDY}/sims"
        " {params.last} --out {output} --threads {threads} 2> {log}"


rule simulate:
    # One deck, solved once: the name of its folder is the hash of the deck, its includes and the solver.
    input:
        deck_files,
    output:
        f"{STUDY}/sims/{{sim}}/solution.npz",
    log:
        f"{STUDY}/sims/{{sim}}/solver.log",
    threads: 1
    resources:
        mem_mb=1000,
    cache: "omit-software"
    shell:
        "fingerfit simulate {input[0]} --solver {input[1]} --out {output} --threads {threads} 2> {log}"
