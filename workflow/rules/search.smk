localrules:
    propose,


checkpoint propose:
    # Scores the guesses of the round before and asks for the next ones, or says stop. It solves short simulations itself.
    input:
        before=before_round,
        meshes=meshes,
        settings="{study}/{model}/settings.json",
        data=data,
    output:
        round="{study}/{model}/rounds/{round}.json",
    log:
        "{study}/{model}/logs/propose/{round}.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: share_of_machine
    resources:
        mem_mb=memory(2),
        runtime=minutes("propose"),
        # no params: where a simulation is solved, and how long it may take, changes no answer
        solve=solves_inside,
        time_limit=time_limit,
    params:
        settings=part("propose", "settings"),
        last=last_option,
        code=part("propose", "code"),
        made_from=part("propose", "made_from"),
        meshes=mesh_options,
        sims=sims,
    shell:
        "exec python -P -m fingerfit propose {input.settings} --data {input.data} {params.meshes} --sims {params.sims}"
        " {params.last} --out {output.round} --threads {threads} --solve {resources.solve}"
        " --time-limit {resources.time_limit} 2> {log}"


rule simulate:
    # One deck, solved once: the name of its folder is the hash of the deck, its includes and the solver.
    input:
        deck=of_simulation(0),
        solver=of_simulation(1),
        included=of_simulation(2),
    output:
        solution="{study}/sims/{sim}/solution.npz",
    log:
        "{study}/sims/{sim}/solver.log",
    cache: "omit-software"
    conda:
        "../envs/fingerfit.yaml"
    threads: 1
    resources:
        mem_mb=memory(1, False),
        runtime=minutes("simulate"),
        # no param: another limit gives no other answer, and must not solve anything again; 0: the solver's own
        time_limit=time_limit,
    shell:
        "exec python -P -m fingerfit simulate {input.deck} --solver {input.solver} --time-limit {resources.time_limit}"
        " --out {output.solution} --threads {threads} 2> {log}"
