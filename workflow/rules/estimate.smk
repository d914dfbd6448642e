rule estimate:
    # The constants with their standard errors, from the last round and the sensitivities it asked for.
    input:
        meshes=meshes,
        rounds=rounds_and_solutions,
        last=last_round,
        settings="{study}/{model}/settings.json",
        data=data,
    output:
        estimate="{study}/{model}/estimate.json",
        table=report(
            "{study}/{model}/table.txt",
            caption="../report/table.rst",
            category="{study}",
            subcategory="{model}",
            labels={"result": "constants"},
        ),
    log:
        "{study}/{model}/logs/estimate.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: beside_figures
    resources:
        mem_mb=memory(2),
        runtime=minutes("estimate"),
    params:
        settings=part("estimate", "settings"),
        code=part("estimate", "code"),
        made_from=part("estimate", "made_from"),
        meshes=mesh_options,
        sims=sims,
    shell:
        "exec python -P -m fingerfit estimate {input.settings} --data {input.data} {params.meshes}"
        " --sims {params.sims} --last {input.last} --threads {threads} --out {output.estimate}"
        " --table {output.table} 2> {log}"


for number, figures in enumerate(FIGURES):

    rule:
        # All figures of a model: deformed mesh, pictures, force against displacement, course of the search.
        name:
            f"plot{number or ''}"
        input:
            meshes=meshes,
            rounds=rounds_and_solutions,
            settings="{study}/{model}/settings.json",
            data=data,
            last=last_round,
        output:
            figures=[
                report(
                    f"{{study}}/{{model}}/figures/{figure}.png",
                    caption=f"../report/{figure.partition('-')[0]}.rst",
                    category="{study}",
                    subcategory="{model}",
                    labels={"result": figure},
                )
                for figure in figures
            ],
        log:
            "{study}/{model}/logs/plot.log",
        wildcard_constraints:
            study=drawn(figures),
        conda:
            "../envs/fingerfit.yaml"
        threads: 1
        resources:
            mem_mb=memory(),
            runtime=minutes("plot"),
        params:
            code=part("plot", "code"),
            made_from=part("plot", "made_from"),
            meshes=mesh_options,
            sims=sims,
            figures=subpath(output[0], parent=True),
        shell:
            "exec python -P -m fingerfit plot {input.settings} --data {input.data} {params.meshes}"
            " --sims {params.sims} --last {input.last} --out {params.figures} 2> {log}"
