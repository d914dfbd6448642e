localrules:
    propose,


checkpoint propose:
    # Scores the guesses of the round before and asks for the next ones, or says stop.
    input:
        **MESHES,
        before=before_round,
        settings=ancient(SETTINGS_FILE),
        data=f"{MODEL}/prepared.npz",
    output:
        round=f"{MODEL}/rounds/{{round}}.json",
    log:
        f"{MODEL}/logs/propose/{{round}}.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: 2
    resources:
        mem_mb=1000,
    params:
        settings=PARTS["propose"],
        last=last_option,
        code=CODE["propose"],
        made_from=MADE_FROM["propose"],
        meshes=MESH_OPTIONS,
        sims=SIMS,
    shell:
        "exec python -P -m fingerfit propose {input.settings} --data {input.data} {params.meshes} --sims {params.sims}"
        " {params.last} --out {output.round} --threads {threads} 2> {log}"


rule simulate:
    # One deck, solved once: the name of its folder is the hash of the deck, its includes and the solver.
    input:
        deck=deck,
        solver=solver,
        included=included,
    output:
        solution=f"{SIMS}/{{sim}}/solution.npz",
    log:
        f"{SIMS}/{{sim}}/solver.log",
    cache: "omit-software"
    conda:
        "../envs/fingerfit.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        # no param: another limit gives no other answer, and must not solve anything again; 0: the solver's own
        time_limit=SETTINGS.time_limit or 0,
    shell:
        "exec python -P -m fingerfit simulate {input.deck} --solver {input.solver} --time-limit {resources.time_limit}"
        " --out {output.solution} --threads {threads} 2> {log}"
