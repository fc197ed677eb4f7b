package deploy

import (
	"fmt"

	appsv1 "k8s.io/api/apps/v1"
	corev1 "k8s.io/api/core/v1"
	networkingv1 "k8s.io/api/networking/v1"
	policyv1 "k8s.io/api/policy/v1"
	metav1 "k8s.io/apimachinery/pkg/apis/meta/v1"
	"sigs.k8s.io/yaml"
)

// release is what the chart made, decoded.
type release struct {
	deployments     []*appsv1.Deployment
	statefulSets    []*appsv1.StatefulSet
	services        []*corev1.Service
	accounts        []*corev1.ServiceAccount
	claims          []*corev1.PersistentVolumeClaim
	budgets         []*policyv1.PodDisruptionBudget
	policies        []*networkingv1.NetworkPolicy
	ingresses       []*networkingv1.Ingress
	scaledObjects   []*scaledObject
	serviceMonitors []*serviceMonitor
	podMonitors     []*podMonitor
	rules           []*prometheusRule
}

// add decodes a manifest strictly: a field that its type does not have is an error.
func (r *release) add(document string) error {
	var kind metav1.TypeMeta
	if err := yaml.Unmarshal([]byte(document), &kind); err != nil {
		return err
	}
	switch kind.APIVersion + " " + kind.Kind {
	case "apps/v1 Deployment":
		return into(document, &r.deployments)
	case "apps/v1 StatefulSet":
		return into(document, &r.statefulSets)
	case "v1 Service":
		return into(document, &r.services)
	case "v1 ServiceAccount":
		return into(document, &r.accounts)
	case "v1 PersistentVolumeClaim":
		return into(document, &r.claims)
	case "policy/v1 PodDisruptionBudget":
		return into(document, &r.budgets)
	case "networking.k8s.io/v1 NetworkPolicy":
		return into(document, &r.policies)
	case "networking.k8s.io/v1 Ingress":
		return into(document, &r.ingresses)
	case "keda.sh/v1alpha1 ScaledObject":
		return into(document, &r.scaledObjects)
	case "monitoring.coreos.com/v1 ServiceMonitor":
		return into(document, &r.serviceMonitors)
	case "monitoring.coreos.com/v1 PodMonitor":
		return into(document, &r.podMonitors)
	case "monitoring.coreos.com/v1 PrometheusRule":
		return into(document, &r.rules)
	}
	return fmt.Errorf("unexpected kind %s %s", kind.APIVersion, kind.Kind)
}

func into[T any](document string, all *[]*T) error {
	object := new(T)
	if err := yaml.UnmarshalStrict([]byte(document), object); err != nil {
		return err
	}
	*all = append(*all, object)
	return nil
}

// workload is what runs pods.
type workload struct {
	name     string
	selector *metav1.LabelSelector
	template corev1.PodTemplateSpec
	replicas *int32
}

func (r *release) workloads() []workload {
	var all []workload
	for _, d := range r.deployments {
		all = append(all, workload{d.Name, d.Spec.Selector, d.Spec.Template, d.Spec.Replicas})
	}
	for _, s := range r.statefulSets {
		w := workload{s.Name, s.Spec.Selector, s.Spec.Template, s.Spec.Replicas}
		for _, claim := range s.Spec.VolumeClaimTemplates {
			w.template.Spec.Volumes = append(w.template.Spec.Volumes, corev1.Volume{
				Name: claim.Name, VolumeSource: corev1.VolumeSource{PersistentVolumeClaim: &corev1.PersistentVolumeClaimVolumeSource{}},
			})
		}
		all = append(all, w)
	}
	return all
}

// hasPort tells whether a pod of the workload has a port of this name.
func (w workload) hasPort(name string) bool {
	for _, c := range w.template.Spec.Containers {
		for _, p := range c.Ports {
			if p.Name == name {
				return true
			}
		}
	}
	return false
}
